"""A shape that judges bodies: compiled once, or run by pySHACL where it uses what the compiler does not know."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, NamedNode, Triple

from gateway.base.lazy_imports import Lazily
from gateway.rdf.compiled import Data, Guard, Unsupported, Violation, compile_shape, report
from gateway.rdf.graph import Node
from gateway.rdf.unused import renamed
from gateway.rdf.validation import FOCUS, from_rdflib, targeted, to_rdflib, validate

if TYPE_CHECKING:
    import rdflib
else:
    rdflib = Lazily("rdflib")

_MOST_TOLD = 5  # the report has them all


class Judge:
    """The shape ``shape`` among ``triples``. Equal verdicts either way; pySHACL takes a hundred times as long."""

    def __init__(self, triples: Sequence[Triple], shape: Node) -> None:
        self._shapes: rdflib.Graph | None = None
        self._guard: Guard | None = None
        try:
            self._guard = compile_shape(triples, shape)
        except Unsupported:
            self._shapes = targeted(triples, shape)

    def report(self, body: Sequence[Triple], focus: Node, request: str) -> tuple[str, list[Triple]] | None:
        """None for a body that conforms; else in one sentence what is wrong, and the validation report (SHACL, 3.6)."""
        if self._guard is None:
            return self._slowly(body, focus, request)
        violations = self._guard.check(Data(body), focus)
        if not violations:
            return None
        messages = list(dict.fromkeys(each.message for each in _direct(violations)))
        return _sentence(messages), report(violations, self._guard.triples)

    def _slowly(self, body: Sequence[Triple], focus: Node, request: str) -> tuple[str, list[Triple]] | None:
        assert self._shapes is not None
        data = to_rdflib(renamed(reachable(body, focus), focus, FOCUS))
        conforms, found = validate(data, self._shapes)
        if conforms:
            return None
        messages = sorted(str(message) for message in found.objects(None, rdflib.SH.resultMessage))
        return _sentence(messages).replace(FOCUS.value, "the body"), from_rdflib(found, request)


def reachable(body: Sequence[Triple], focus: Node) -> list[Triple]:
    """What is said about ``focus`` and about the nodes that this refers to."""
    by_subject: dict[object, list[Triple]] = {}
    for triple in body:
        by_subject.setdefault(triple.subject, []).append(triple)
    found: list[Triple] = []
    pending: list[object] = [focus]
    while pending:
        for triple in by_subject.pop(pending.pop(), ()):
            found.append(triple)
            if isinstance(triple.object, NamedNode | BlankNode):
                pending.append(triple.object)
    return found


def _direct(violations: Sequence[Violation]) -> list[Violation]:
    """Without those that others explain: of two units, or an unknown one, no branch of an ``sh:or`` holds."""
    said = {(each.focus, each.path) for each in violations if not each.detail}
    return [each for each in violations if not any((inner.focus, inner.path) in said for inner in each.detail)]


def _sentence(messages: Sequence[str]) -> str:
    more = [f"and {len(messages) - _MOST_TOLD} more"] if len(messages) > _MOST_TOLD else []
    return "; ".join([*messages[:_MOST_TOLD], *more])
