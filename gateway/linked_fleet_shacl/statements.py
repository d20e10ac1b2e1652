"""Strict access to the statements of a shape, and the focus nodes that its targets select (SHACL 2.1.3).

Anything that SHACL does not allow is Unsupported.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Protocol

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_shacl.check import Shape
from linked_fleet_shacl.data import Data
from linked_fleet_shacl.report import Statements, TermTexts, term_text
from linked_fleet_shacl.terms import RDF, RDFS, SHACL, XSD, Node, Term


class Unsupported(ValueError):  # noqa: N818 - named for the state of the shape
    """A shape is malformed or uses a construct that the compiler does not know. The message has the reason."""


class Shapes(Protocol):
    """The part of the shapes graph that constraints refer to."""

    texts: TermTexts

    def shape(self, node: Term, depth: int) -> Shape: ...
    def items(self, head: Term) -> list[Term]: ...
    def paths(self, properties: Iterable[Term]) -> Iterable[NamedNode]: ...
    def requires(self, shape: Shape) -> Mapping[NamedNode, frozenset[Term]]: ...


_TRUE, _FALSE = (Literal(text, datatype=XSD.boolean) for text in ("true", "false"))


def exactly_one(stated: Statements, predicate: NamedNode) -> Term:
    values = stated.get(predicate, ())
    if len(values) != 1:
        raise Unsupported(f"{len(values)} values of {term_text(predicate)}")
    return values[0]


def at_most_one(stated: Statements, predicate: NamedNode) -> Term | None:
    return exactly_one(stated, predicate) if predicate in stated else None


def natural_number(stated: Statements, predicate: NamedNode) -> int:
    term = exactly_one(stated, predicate)
    number = _natural_number(term)
    if number is None:
        raise Unsupported(f"{term_text(predicate)} {term_text(term)}")
    return number


@lru_cache
def _natural_number(term: Term) -> int | None:
    is_integer = isinstance(term, Literal) and term.datatype == XSD.integer
    return int(term.value) if is_integer and re.fullmatch("[0-9]{1,18}", term.value) else None


def boolean(stated: Statements, predicate: NamedNode) -> bool:
    """Return a boolean. Only ``true`` and ``false`` are valid: in the W3C suite "1"^^xsd:boolean is not true."""
    term = exactly_one(stated, predicate)
    if term not in (_TRUE, _FALSE):
        raise Unsupported(f"{term_text(predicate)} {term_text(term)}")
    return term == _TRUE


def ground_terms(terms: Iterable[Term]) -> list[Term]:
    """Return ``terms`` of a shape that can equal terms of the data, which blank nodes cannot."""
    found = list(terms)
    if any(isinstance(term, BlankNode) for term in found):
        raise Unsupported("a blank node as value")
    return found


def text_of(term: Term, predicate: NamedNode) -> str:
    if not isinstance(term, Literal) or term.datatype != XSD.string:
        raise Unsupported(f"{term_text(predicate)} {term_text(term)}")
    return term.value


def predicate_of(term: Term, parameter: NamedNode) -> NamedNode:
    if not isinstance(term, NamedNode):
        raise Unsupported(f"{term_text(parameter)} {term_text(term)}")
    return term


def _of_class(data: Data, wanted: Term) -> Iterable[Term]:
    return (node for each in data.subclasses(wanted) for node in data.subjects(RDF.type, each))


def _subjects_of(data: Data, predicate: Term) -> Iterable[Term]:
    return (subject for subject, _ in data.subject_objects(predicate))


def _objects_of(data: Data, predicate: Term) -> Iterable[Term]:
    return (value for _, value in data.subject_objects(predicate))


TARGETS: Mapping[NamedNode, Callable[[Data, Term], Iterable[Term]]] = {
    SHACL.targetNode: lambda _, node: (node,),
    SHACL.targetClass: _of_class,
    SHACL.targetSubjectsOf: _subjects_of,
    SHACL.targetObjectsOf: _objects_of,
}
_ANY = (*TARGETS, SHACL.target)  # a shape with sh:target is refused as unsupported


def targets(triples: Iterable[Triple]) -> list[tuple[Node, Callable[[Data], Iterable[Term]]]]:
    """Return the shapes of a graph that have targets, each with a function that finds its focus nodes."""
    shapes = Data(list(triples))
    nodes = [
        node
        for node in shapes.nodes()
        if any(each in shapes.statements(node) for each in _ANY) or _is_class(shapes, node)
    ]
    return [(node, _finder(shapes, node)) for node in nodes]


def _is_class(shapes: Data, node: Node) -> bool:
    """Return True for a shape that is also a class, whose instances are implicit targets (SHACL 2.1.3.3).

    Its parameters make it a shape; one that has only the type of a shape refuses nothing.
    """
    stated = shapes.statements(node)
    return shapes.is_a(node, RDFS.Class) and any(predicate.value.startswith(SHACL.iri) for predicate in stated)


def _finder(shapes: Data, shape: Node) -> Callable[[Data], Iterable[Term]]:
    stated = [(find, term) for each, find in TARGETS.items() for term in ground_terms(shapes.objects(shape, each))]
    if _is_class(shapes, shape):
        stated.append((_of_class, shape))
    return lambda data: dict.fromkeys(node for find, term in stated for node in find(data, term))
