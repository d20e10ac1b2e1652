"""Compilation of constraints that relate a focus node, the values of a path and the surrounding data."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from pyoxigraph import Literal, NamedNode

from linked_fleet_shacl.check import Relation, Values
from linked_fleet_shacl.data import Data
from linked_fleet_shacl.report import Statements, TermTexts
from linked_fleet_shacl.statements import Shapes, Unsupported, at_most_one, boolean, predicate_of
from linked_fleet_shacl.terms import SHACL, Term


def _unique_lang(_shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Relation]:
    if SHACL.path not in stated:
        raise Unsupported("sh:uniqueLang in a node shape")
    if boolean(stated, SHACL.uniqueLang):
        yield Relation(SHACL.UniqueLangConstraintComponent, lambda: "have one text in each language at most", _repeated)


def _repeated(_data: Data, _focus: Term, values: Values) -> Iterable[tuple[None, None]]:
    """Return one breach for each language that has several values."""
    tags = Counter(value.language.lower() for value in values if isinstance(value, Literal) and value.language)
    return ((None, None) for count in tags.values() if count > 1)


def _equals(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Relation]:
    for other in stated[SHACL.equals]:
        yield _differing(predicate_of(other, SHACL.equals), shapes.texts)


def _differing(other: NamedNode, texts: TermTexts) -> Relation:
    def breaches(data: Data, focus: Term, values: Values) -> Iterable[tuple[None, Term]]:
        own, others = dict.fromkeys(values), dict.fromkeys(data.objects(focus, other))
        yield from ((None, value) for value in own if value not in others)
        yield from ((None, value) for value in others if value not in own)

    return Relation(SHACL.EqualsConstraintComponent, lambda: f"have the values of {texts.text(other)}", breaches)


def _disjoint(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Relation]:
    for other in stated[SHACL.disjoint]:
        yield _shared(predicate_of(other, SHACL.disjoint), shapes.texts)


def _shared(other: NamedNode, texts: TermTexts) -> Relation:
    def breaches(data: Data, focus: Term, values: Values) -> Iterable[tuple[None, Term]]:
        others = set(data.objects(focus, other))
        return ((None, value) for value in values if value in others)

    return Relation(SHACL.DisjointConstraintComponent, lambda: f"have no value of {texts.text(other)}", breaches)


def _closed(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Relation]:
    if not boolean(stated, SHACL.closed):
        return
    known = set(shapes.paths(stated.get(SHACL.property, ())))
    if ignored := at_most_one(stated, SHACL.ignoredProperties):
        known.update(predicate_of(term, SHACL.ignoredProperties) for term in shapes.items(ignored))

    def breaches(data: Data, _focus: Term, values: Values) -> Iterable[tuple[NamedNode, Term]]:
        for node in values:
            for predicate, found in data.statements(node).items():
                if predicate not in known:
                    yield from ((predicate, value) for value in found)

    yield Relation(SHACL.ClosedConstraintComponent, lambda: "have no other properties", breaches)


RELATIONS: Mapping[NamedNode, Callable[[Shapes, Statements, int], Iterable[Relation]]] = {
    SHACL.uniqueLang: _unique_lang,
    SHACL.equals: _equals,
    SHACL.disjoint: _disjoint,
    SHACL.closed: _closed,
}
