"""What a compiled shape says of a body that it refuses: violations, in words for people and as a SHACL report."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from gateway.rdf.compiled_data import NUMERIC
from gateway.rdf.graph import Graph, Node, Term
from gateway.rdf.vocabulary import PREFIXES, XSD, Namespace

SHACL = Namespace(
    "http://www.w3.org/ns/shacl#",
    # what the compiler understands
    "path property node and or not xone minCount maxCount datatype nodeKind class in hasValue"
    " minInclusive minExclusive maxInclusive maxExclusive minLength maxLength pattern flags"
    " qualifiedValueShape qualifiedMinCount qualifiedMaxCount qualifiedValueShapesDisjoint"
    " inversePath alternativePath zeroOrMorePath oneOrMorePath zeroOrOnePath"
    " name description order group defaultValue message severity deactivated parameter"
    " targetClass targetNode targetSubjectsOf targetObjectsOf"
    " IRI BlankNode Literal BlankNodeOrIRI BlankNodeOrLiteral IRIOrLiteral"
    # what a report says
    " Violation ValidationReport ValidationResult conforms result detail focusNode resultPath value"
    " sourceConstraintComponent sourceShape resultMessage resultSeverity"
    " MinCountConstraintComponent MaxCountConstraintComponent DatatypeConstraintComponent NodeKindConstraintComponent"
    " ClassConstraintComponent InConstraintComponent HasValueConstraintComponent MinInclusiveConstraintComponent"
    " MinExclusiveConstraintComponent MaxInclusiveConstraintComponent MaxExclusiveConstraintComponent"
    " MinLengthConstraintComponent MaxLengthConstraintComponent PatternConstraintComponent OrConstraintComponent"
    " AndConstraintComponent NotConstraintComponent XoneConstraintComponent NodeConstraintComponent"
    " QualifiedMinCountConstraintComponent QualifiedMaxCountConstraintComponent",
)
_T = TypeVar("_T", NamedNode | BlankNode, NamedNode | BlankNode | Literal)
_LONGEST = 80  # characters of one term in a message
_LONGEST_TEXT = 300
_LONGEST_VALUE = 1024  # of a term that is repeated as it came
_MOST_LISTED = 20


@dataclass(frozen=True)
class Violation:
    """One result of validation; ``detail`` has those of the shapes that ``sh:node``, ``sh:or`` and the like refer to.

    ``path`` is the predicate or, for any other path, its node in the shapes graph; ``message`` says
    what would be right.
    """

    focus: Term
    path: Node | None
    value: Term | None
    component: NamedNode
    shape: Node
    message: str
    detail: tuple["Violation", ...] = ()


def report(violations: Sequence[Violation], shapes: Mapping[Node, Sequence[Triple]] | None = None) -> list[Triple]:
    """A ``sh:ValidationReport``; with ``shapes`` (``Guard.triples``) a path that is no predicate is spelt out.

    Blank nodes get labels by where they come from, since those of a body and of a shape may be the same.
    """
    graph = Graph()
    root = graph.blank(SHACL.ValidationReport)
    graph.add(root, SHACL.conforms, Literal("false" if violations else "true", datatype=XSD.boolean))
    _add_results(graph, root, SHACL.result, violations, shapes or {})
    return graph.triples


def _add_results(
    graph: Graph,
    parent: Node,
    link: NamedNode,
    violations: Iterable[Violation],
    shapes: Mapping[Node, Sequence[Triple]],
) -> None:
    for violation in violations:
        result = graph.blank(SHACL.ValidationResult)
        graph.add(parent, link, result)
        graph.add(result, SHACL.focusNode, _relabel(violation.focus, "body"))
        if violation.path is not None:
            graph.add(result, SHACL.resultPath, _relabel(violation.path, "shape"))
            _spell_out(graph, violation.path, shapes)
        if violation.value is not None and len(violation.value.value) <= _LONGEST_VALUE:
            graph.add(result, SHACL.value, _relabel(violation.value, "body"))
        graph.add(result, SHACL.sourceConstraintComponent, violation.component)
        graph.add(result, SHACL.sourceShape, _relabel(violation.shape, "shape"))
        graph.add(result, SHACL.resultSeverity, SHACL.Violation)
        graph.add(result, SHACL.resultMessage, Literal(violation.message))
        _add_results(graph, result, SHACL.detail, violation.detail, shapes)


def _spell_out(graph: Graph, path: Term, shapes: Mapping[Node, Sequence[Triple]]) -> None:
    if isinstance(path, BlankNode):
        for triple in shapes.get(path, ()):
            value: Term = triple.object  # type: ignore[assignment]
            graph.add(BlankNode(f"shape-{path.value}"), triple.predicate, _relabel(value, "shape"))
            _spell_out(graph, value, shapes)


def _relabel(term: _T, origin: str) -> _T:
    return BlankNode(f"{origin}-{term.value}") if isinstance(term, BlankNode) else term


def shown(term: object) -> str:
    """A term as a person reads it: vom:unit, 43.6, 'abc'."""
    if isinstance(term, NamedNode):
        return _compact(term.value)
    if isinstance(term, Literal):
        text = _cut(term.value)
        return text if term.datatype in NUMERIC and text and text == text.strip() else repr(text)
    return "a blank node" if isinstance(term, BlankNode) else "a triple"


def listed(terms: Collection[object]) -> str:
    texts = [shown(term) for term in islice(terms, _MOST_LISTED)]
    more = [] if len(terms) <= _MOST_LISTED else [f"{len(terms) - _MOST_LISTED} more"]
    return ", ".join(texts + more)


def brief(text: str) -> str:
    return text if len(text) <= _LONGEST_TEXT else text[: _LONGEST_TEXT - 1] + "…"


def _compact(iri: str) -> str:
    for prefix, namespace in PREFIXES.items():
        if iri.startswith(namespace) and len(iri) > len(namespace):
            return _cut(f"{prefix}:{iri[len(namespace) :]}")
    return _cut(f"<{iri}>")


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
