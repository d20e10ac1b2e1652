"""Bodies from clients, judged: by a published shape, and as far as no shape judges them."""

import math
import re
from collections.abc import Iterable, Sequence

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.rdf.graph import Node
from linked_fleet_gateway.rdf.vocabulary import NUMERIC, PREFIXES, XSD
from linked_fleet_gateway.shacl import Data, Violation, compile_shape, report

# The lexical spaces of XML Schema 2, 3.2 and 3.3 (RDF 1.1 Concepts, 5.1), without white space, which only XML
# collapses. Python's float accepts more, such as 1_0.
_INTEGER = re.compile(r"[+-]?[0-9]+")
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_LEXICAL = {XSD.decimal: _DECIMAL, XSD.float: _FLOAT, XSD.double: _FLOAT}
_XML_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*\Z")


def root(body: Sequence[Triple], request: NamedNode) -> Node:
    """Return ``<>``, else the only subject that is not an object (DESIGN: "body of an action")."""
    subjects = dict.fromkeys(t.subject for t in body)
    if request in subjects:
        return request
    objects = {t.object for t in body}
    roots = [s for s in subjects if s not in objects]
    if len(roots) != 1:
        found = "no triples" if not body else f"{len(roots)} subjects that nobody refers to"
        raise UnprocessableContent(
            f"The body has {found}; it needs one root: <> (the request URI), or the only subject "
            "that is nobody's object.",
            constraint=request.value,
        )
    return roots[0]  # type: ignore[return-value]


def check_writable(triples: Sequence[Triple], constraint: str) -> None:
    """Raise UnprocessableContent for a predicate without an XML name, which could not be read as RDF/XML."""
    unwritable = [t.predicate.value for t in triples if not _XML_NAME.search(t.predicate.value)]
    if unwritable:
        raise UnprocessableContent(
            f"RDF/XML cannot say <{unwritable[0][:200]}>: a predicate ends in a name, such as label or isOwnedBy.",
            constraint=constraint,
        )


def check_lexical_forms(body: Sequence[Triple], constraint: str) -> None:
    for triple in body:
        literal = triple.object
        if isinstance(literal, Literal) and literal.datatype in NUMERIC:
            lexical = _LEXICAL.get(literal.datatype, _INTEGER).fullmatch(literal.value)
            if not lexical or not math.isfinite(float(literal.value)):
                raise UnprocessableContent(
                    f"{literal.value[:80]!r} is no finite number of type {literal.datatype.value}; write e.g. 43.6.",
                    constraint=constraint,
                )


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
