"""Validation of request bodies with a published shape; violations as a sentence and as a validation report."""

from collections.abc import Iterable, Sequence

from pyoxigraph import Triple

from linked_fleet_gateway.rdf.graph import Node
from linked_fleet_gateway.rdf.vocabulary import PREFIXES
from linked_fleet_gateway.shacl import Data, Violation, compile_shape, report

_MOST_TOLD = 5  # the report contains all of them


class ShaclValidator:
    """Validates with ``shape`` among ``triples``. Raises Unsupported, with the reason, if it cannot be compiled."""

    def __init__(self, triples: Iterable[Triple], shape: Node) -> None:
        self._shape = compile_shape(triples, shape, PREFIXES)

    def report(self, body: Sequence[Triple], focus: Node) -> tuple[str, list[Triple]] | None:
        """Return None if the body conforms, else a sentence about the violations and the validation report (SHACL,
        3.6).
        """
        violations = self._shape.check(Data(body), focus)
        if not violations:
            return None
        messages = list(dict.fromkeys(each.message for each in _direct(violations)))
        return _sentence(messages), report(violations, self._shape.triples)


def _direct(violations: Sequence[Violation]) -> list[Violation]:
    """Drop violations that others explain: with two units, or an unknown one, no branch of an ``sh:or`` holds."""
    said = {(each.focus, each.path) for each in violations if not each.detail}
    return [each for each in violations if not any((inner.focus, inner.path) in said for inner in each.detail)]


def _sentence(messages: Sequence[str]) -> str:
    more = [f"and {len(messages) - _MOST_TOLD} more"] if len(messages) > _MOST_TOLD else []
    return "; ".join([*messages[:_MOST_TOLD], *more])
