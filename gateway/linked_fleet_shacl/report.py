"""Violations of a compiled shape as text and as a SHACL report."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple, TypeVar

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_shacl.terms import NUMERIC, PREFIXES, RDF, SHACL, XSD, Node, Term

_T = TypeVar("_T", NamedNode | BlankNode, NamedNode | BlankNode | Literal)
_LONGEST = 80  # characters of one term in a message
_LONGEST_TEXT = 300
_LONGEST_VALUE = 1024  # of a value in the report
_MOST_LISTED = 20


class Violation(NamedTuple):
    """One validation result; ``detail`` has the results of the shapes that ``sh:node``, ``sh:or`` and similar refer to.

    ``path`` is the predicate or, for a complex path, its node in the shapes graph. ``message`` states the valid form.
    """

    focus: Term
    path: Node | None
    value: Term | None
    component: NamedNode
    shape: Node
    message: str
    detail: tuple["Violation", ...]
    severity: NamedNode


Statement = tuple[Node, NamedNode, Term]
"""One statement. A ``Triple`` of pyoxigraph takes many times as long to create."""
AnyTriple = Triple | Statement
Statements = Mapping[NamedNode, Sequence[Term]]
"""What is stated about one node, by predicate."""


def report(violations: Sequence[Violation], shapes: Mapping[Node, Statements] | None = None) -> list[Statement]:
    """Return a ``sh:ValidationReport``; with ``shapes`` (``CompiledShape.statements``) complex paths are included.

    Blank nodes get labels by origin, because labels of the data and of a shape may coincide.
    """
    written = _Report(shapes or {})
    root = written.blank(SHACL.ValidationReport)
    written.add(root, SHACL.conforms, Literal("false" if violations else "true", datatype=XSD.boolean))
    written.results(root, SHACL.result, violations)
    return written.statements


class _Report:
    def __init__(self, shapes: Mapping[Node, Statements]) -> None:
        self.statements: list[Statement] = []
        self._shapes = shapes
        self._spelt_out: set[BlankNode] = set()
        self._labels = 0

    def add(self, subject: Node, predicate: NamedNode, value: Term) -> None:
        self.statements.append((subject, predicate, value))

    def blank(self, type_: NamedNode) -> BlankNode:
        self._labels += 1
        node = BlankNode(f"b{self._labels}")
        self.add(node, RDF.type, type_)
        return node

    def results(self, parent: Node, link: NamedNode, violations: Iterable[Violation]) -> None:
        for violation in violations:
            result = self.blank(SHACL.ValidationResult)
            self.add(parent, link, result)
            self.add(result, SHACL.focusNode, _relabel(violation.focus, "body"))
            if violation.path is not None:
                self.add(result, SHACL.resultPath, _relabel(violation.path, "shape"))
                self._spell_out(violation.path)
            if violation.value is not None and len(violation.value.value) <= _LONGEST_VALUE:
                self.add(result, SHACL.value, _relabel(violation.value, "body"))
            self.add(result, SHACL.sourceConstraintComponent, violation.component)
            self.add(result, SHACL.sourceShape, _relabel(violation.shape, "shape"))
            self.add(result, SHACL.resultSeverity, violation.severity)
            self.add(result, SHACL.resultMessage, Literal(violation.message))
            self.results(result, SHACL.detail, violation.detail)

    def _spell_out(self, path: Term) -> None:
        if isinstance(path, BlankNode) and path not in self._spelt_out:
            self._spelt_out.add(path)
            for predicate, values in self._shapes.get(path, {}).items():
                for value in values:
                    self.add(_relabel(path, "shape"), predicate, _relabel(value, "shape"))
                    self._spell_out(value)


def _relabel(term: _T, origin: str) -> _T:
    return BlankNode(f"{origin}-{term.value}") if isinstance(term, BlankNode) else term


@dataclass(frozen=True)
class TermTexts:
    """Formats terms for people, shortening IRIs by ``prefixes``."""

    prefixes: Mapping[str, str]

    def text(self, term: object) -> str:
        """Return one term as text: vom:unit, 43.6, 'abc'."""
        if isinstance(term, NamedNode):
            return self._compact(term.value)
        if isinstance(term, Literal):
            text = _cut(term.value)
            return text if term.datatype in NUMERIC and text and text == text.strip() else repr(text)
        return "a blank node" if isinstance(term, BlankNode) else "a triple"

    def list_text(self, terms: Collection[object]) -> str:
        texts = [self.text(term) for term in islice(terms, _MOST_LISTED)]
        more = [] if len(terms) <= _MOST_LISTED else [f"{len(terms) - _MOST_LISTED} more"]
        return ", ".join(texts + more)

    def _compact(self, iri: str) -> str:
        for prefix, namespace in self.prefixes.items():
            if iri.startswith(namespace) and len(iri) > len(namespace):
                return _cut(f"{prefix}:{iri[len(namespace) :]}")
        return _cut(f"<{iri}>")


term_text = TermTexts(PREFIXES).text


def shortened(text: str) -> str:
    return text if len(text) <= _LONGEST_TEXT else text[: _LONGEST_TEXT - 1] + "…"


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
