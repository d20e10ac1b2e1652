"""Strict access to the statements of a shape: anything that SHACL does not allow is Unsupported."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.shacl.check import Shape
from linked_fleet_gateway.shacl.report import Words, shown
from linked_fleet_gateway.shacl.terms import XSD, Term

Statements = Mapping[NamedNode, Sequence[Term]]


class Unsupported(ValueError):  # noqa: N818 - named for the state of the shape
    """A shape is malformed or uses a construct that the compiler does not know. The message has the reason."""


class Shapes(Protocol):
    """The part of the shapes graph that constraints refer to."""

    words: Words

    def shape(self, node: Term, depth: int) -> Shape: ...
    def items(self, head: Term) -> list[Term]: ...
    def paths(self, properties: Iterable[Term]) -> Iterable[NamedNode]: ...


_TRUE, _FALSE = (Literal(text, datatype=XSD.boolean) for text in ("true", "false"))


def one(stated: Statements, predicate: NamedNode) -> Term:
    values = stated.get(predicate, ())
    if len(values) != 1:
        raise Unsupported(f"{len(values)} values of {shown(predicate)}")
    return values[0]


def at_most_one(stated: Statements, predicate: NamedNode) -> Term | None:
    return one(stated, predicate) if predicate in stated else None


def natural(stated: Statements, predicate: NamedNode) -> int:
    term = one(stated, predicate)
    digits = isinstance(term, Literal) and term.datatype == XSD.integer and re.fullmatch("[0-9]{1,18}", term.value)
    if not digits:
        raise Unsupported(f"{shown(predicate)} {shown(term)}")
    return int(digits.string)


def true(stated: Statements, predicate: NamedNode) -> bool:
    """Return a boolean. Only ``true`` and ``false`` are valid: in the W3C suite "1"^^xsd:boolean is not true."""
    term = one(stated, predicate)
    if term not in (_TRUE, _FALSE):
        raise Unsupported(f"{shown(predicate)} {shown(term)}")
    return term == _TRUE


def fixed(terms: Iterable[Term]) -> list[Term]:
    """Return ``terms`` of a shape that can equal terms of the data, which blank nodes cannot."""
    found = list(terms)
    if any(isinstance(term, BlankNode) for term in found):
        raise Unsupported("a blank node as value")
    return found


def text_of(term: Term, predicate: NamedNode) -> str:
    if not isinstance(term, Literal) or term.datatype != XSD.string:
        raise Unsupported(f"{shown(predicate)} {shown(term)}")
    return term.value


def predicate_of(term: Term, parameter: NamedNode) -> NamedNode:
    if not isinstance(term, NamedNode):
        raise Unsupported(f"{shown(parameter)} {shown(term)}")
    return term
