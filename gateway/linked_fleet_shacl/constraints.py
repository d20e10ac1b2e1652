"""Compilation of constraints on values into tests of each value, or of all together.

Each accepts the same parameters as pySHACL; a shape that pySHACL would not load is Unsupported.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from operator import ge, gt, le, lt

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_shacl.check import Constraint, Count, Either, Expectation, Shape, Switch, Values
from linked_fleet_shacl.data import Data, comparable_number
from linked_fleet_shacl.report import Statements, TermTexts, shortened, term_text
from linked_fleet_shacl.statements import (
    Shapes,
    Unsupported,
    at_most_one,
    exactly_one,
    ground_terms,
    natural_number,
    text_of,
)
from linked_fleet_shacl.terms import NUMERIC, SHACL, Number, Term, number, well_typed

_FEWEST_BRANCHES = 4  # branches of an sh:or; with fewer, a lookup of the applicable one does not pay
_KINDS: Mapping[Term, tuple[tuple[type, ...], str]] = {
    SHACL.IRI: ((NamedNode,), "an IRI"),
    SHACL.BlankNode: ((BlankNode,), "a blank node"),
    SHACL.Literal: ((Literal,), "a literal"),
    SHACL.BlankNodeOrIRI: ((BlankNode, NamedNode), "an IRI or a blank node"),
    SHACL.BlankNodeOrLiteral: ((BlankNode, Literal), "a literal or a blank node"),
    SHACL.IRIOrLiteral: ((NamedNode, Literal), "an IRI or a literal"),
}


def _min_count(_shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Count]:
    return (_at_least(_of_property(stated, natural_number(stated, SHACL.minCount))),)


def _max_count(_shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Count]:
    return (_at_most(_of_property(stated, natural_number(stated, SHACL.maxCount))),)


@lru_cache
def _at_least(least: int) -> Count:
    text = f"have {_values(least)} or more"
    return Count(SHACL.MinCountConstraintComponent, lambda: text, lambda _, values: len(values) >= least)


@lru_cache
def _at_most(most: int) -> Count:
    text = f"have {_values(most)} at most"
    return Count(SHACL.MaxCountConstraintComponent, lambda: text, lambda _, values: len(values) <= most)


def _of_property(stated: Statements, count: int) -> int:
    if SHACL.path not in stated:
        raise Unsupported("a count in a node shape")
    return count


def _values(count: int) -> str:
    return f"{count} value" if count == 1 else f"{count} values"


def _has_value(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Count]:
    for term in ground_terms(stated[SHACL.hasValue]):
        yield _including(term, shapes.texts)


def _including(term: Term, texts: TermTexts) -> Count:
    return Count(
        SHACL.HasValueConstraintComponent, lambda: f"include {texts.text(term)}", lambda _, values: term in values
    )


def _qualified(shapes: Shapes, stated: Statements, depth: int) -> Iterable[Count]:
    shape = shapes.shape(exactly_one(stated, SHACL.qualifiedValueShape), depth)
    if SHACL.qualifiedMinCount not in stated and SHACL.qualifiedMaxCount not in stated:
        raise Unsupported("sh:qualifiedValueShape without a count")

    def conforming(data: Data, values: Values) -> int:
        return sum(shape.conforms(data, value) for value in values)

    if SHACL.qualifiedMinCount in stated:
        least = _of_property(stated, natural_number(stated, SHACL.qualifiedMinCount))
        yield Count(
            SHACL.QualifiedMinCountConstraintComponent,
            lambda: f"have {_values(least)} or more that are {shape.expected()}",
            lambda data, values: conforming(data, values) >= least,
        )
    if SHACL.qualifiedMaxCount in stated:
        most = _of_property(stated, natural_number(stated, SHACL.qualifiedMaxCount))
        yield Count(
            SHACL.QualifiedMaxCountConstraintComponent,
            lambda: f"have {_values(most)} at most that are {shape.expected()}",
            lambda data, values: conforming(data, values) <= most,
        )


def _datatype(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Constraint]:
    wanted = exactly_one(stated, SHACL.datatype)
    if not isinstance(wanted, NamedNode):
        raise Unsupported(f"sh:datatype {term_text(wanted)}")
    if wanted in NUMERIC:
        holds = _number_of(wanted)
    else:
        formed = well_typed(wanted)
        if formed is None:
            raise Unsupported(f"sh:datatype {term_text(wanted)}")
        holds = _of_type(wanted, formed)
    yield Constraint(SHACL.DatatypeConstraintComponent, lambda: f"of type {shapes.texts.text(wanted)}", holds)


def _number_of(wanted: NamedNode) -> Callable[[Data, Term], bool]:
    return lambda data, value: (
        isinstance(value, Literal) and value.datatype == wanted and data.number(value) is not None
    )


def _of_type(wanted: NamedNode, formed: Callable[[Literal], bool]) -> Callable[[Data, Term], bool]:
    return lambda _, value: isinstance(value, Literal) and value.datatype == wanted and formed(value)


def _node_kind(_shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Constraint]:
    wanted = exactly_one(stated, SHACL.nodeKind)
    if wanted not in _KINDS:
        raise Unsupported(f"sh:nodeKind {term_text(wanted)}")
    types, text = _KINDS[wanted]
    yield Constraint(SHACL.NodeKindConstraintComponent, lambda: text, lambda _, value: isinstance(value, types))


def _class(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Constraint]:
    for wanted in stated[SHACL.class_]:
        if not isinstance(wanted, NamedNode):
            raise Unsupported(f"sh:class {term_text(wanted)}")
        yield _of_class(wanted, shapes.texts)


def _of_class(wanted: NamedNode, texts: TermTexts) -> Constraint:
    return Constraint(
        SHACL.ClassConstraintComponent,
        lambda: f"a {texts.text(wanted)}",
        lambda data, value: data.is_a(value, wanted),
    )


def _in(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Constraint]:
    members = dict.fromkeys(ground_terms(shapes.items(exactly_one(stated, SHACL.in_))))

    def expected() -> str:
        listed = shapes.texts.list_text(members)
        return f"one of {listed}" if len(members) != 1 else listed

    yield Constraint(SHACL.InConstraintComponent, expected, lambda _, value: value in members)


def _limit(
    parameter: NamedNode, component: NamedNode, compare: Callable[[Number, Number], bool], text: str
) -> Callable[[Shapes, Statements, int], Iterable[Constraint]]:
    def constraint(term: Term) -> Constraint:
        bound = number(term) if isinstance(term, Literal) else None
        if bound is None or bound != bound:  # NaN
            raise Unsupported(f"{term_text(parameter)} {term_text(term)}")

        def holds(data: Data, value: Term) -> bool:
            found = comparable_number(value, data)
            return found is not None and compare(found, bound)

        return Constraint(component, lambda: f"{text} {_rounded(bound) or term_text(term)}", holds)

    return lambda _shapes, stated, _depth: [constraint(term) for term in stated[parameter]]


def _rounded(bound: Number) -> str:
    """Return a double with 14 digits: the last ones only reflect its binary fraction."""
    return f"{bound:.14g}" if isinstance(bound, float) else ""


def _min_length(_shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Constraint]:
    least = natural_number(stated, SHACL.minLength)
    # As in pySHACL, minLength 0 accepts everything, even a blank node, which has no length.
    yield Constraint(
        SHACL.MinLengthConstraintComponent,
        lambda: f"{least} or more characters long",
        lambda _, value: least == 0 or (isinstance(value, NamedNode | Literal) and len(value.value) >= least),
    )


def _max_length(_shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Constraint]:
    most = natural_number(stated, SHACL.maxLength)
    yield Constraint(
        SHACL.MaxLengthConstraintComponent,
        lambda: f"{most} characters long at most",
        lambda _, value: isinstance(value, NamedNode | Literal) and len(value.value) <= most,
    )


def _pattern(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Constraint]:
    flags = at_most_one(stated, SHACL.flags)
    if flags is not None and flags != Literal("i"):
        raise Unsupported(f"sh:flags {term_text(flags)}")
    for term in stated[SHACL.pattern]:
        try:
            pattern = re.compile(text_of(term, SHACL.pattern), re.IGNORECASE if flags else 0)
        except re.error as error:
            raise Unsupported(f"sh:pattern {term_text(term)}: {error}") from error
        yield _matching(pattern, term)


def _matching(pattern: re.Pattern[str], stated: Term) -> Constraint:
    return Constraint(
        SHACL.PatternConstraintComponent,
        lambda: f"like {term_text(stated)}",
        lambda _, value: isinstance(value, NamedNode | Literal) and pattern.search(value.value) is not None,
    )


def _language_in(shapes: Shapes, stated: Statements, _depth: int) -> Iterable[Constraint]:
    tags = [text_of(term, SHACL.languageIn).lower() for term in shapes.items(exactly_one(stated, SHACL.languageIn))]
    text = f"in the language {' or '.join(tags)}"
    yield Constraint(SHACL.LanguageInConstraintComponent, lambda: text, _speaking(tags))


def _speaking(ranges: Sequence[str]) -> Callable[[Data, Term], bool]:
    """Return basic filtering (RFC 4647, 3.3.1), like ``langMatches`` of SPARQL."""

    def holds(_: Data, value: Term) -> bool:
        tag = (value.language or "").lower() if isinstance(value, Literal) else ""
        return bool(tag) and any(each in (tag, "*") or tag.startswith(each + "-") for each in ranges)

    return holds


def _node(shapes: Shapes, stated: Statements, depth: int) -> Iterable[Constraint]:
    found = [shapes.shape(term, depth) for term in stated[SHACL.node]]
    if any(shape.path is not None for shape in found):
        raise Unsupported("sh:node of a property shape")
    return [Constraint(SHACL.NodeConstraintComponent, each.expected, each.conforms, (each,)) for each in found]


def _not(shapes: Shapes, stated: Statements, depth: int) -> Iterable[Constraint]:
    for term in stated[SHACL.not_]:
        shape = shapes.shape(term, depth)
        yield _refused(shape)


def _refused(shape: Shape) -> Constraint:
    return Constraint(
        SHACL.NotConstraintComponent,
        lambda: f"other than {shape.expected()}",
        lambda data, value: not shape.conforms(data, value),
    )


def _joined(members: Sequence[Shape], word: str) -> Expectation:
    return lambda: shortened(word.join(dict.fromkeys(shape.expected() for shape in members)))


def _members(shapes: Shapes, head: Term, depth: int) -> tuple[Shape, ...]:
    members = tuple(shapes.shape(term, depth) for term in shapes.items(head))
    if not members:
        raise Unsupported("an empty collection of shapes")
    return members


def _and(shapes: Shapes, stated: Statements, depth: int) -> Iterable[Constraint]:
    for head in stated[SHACL.and_]:
        members = _members(shapes, head, depth)
        holds = _conforming(members, len(members))
        yield Constraint(SHACL.AndConstraintComponent, _joined(members, " and "), holds, members)


def _conforming(members: tuple[Shape, ...], count: int) -> Callable[[Data, Term], bool]:
    return lambda data, value: sum(shape.conforms(data, value) for shape in members) == count


def _xone(shapes: Shapes, stated: Statements, depth: int) -> Iterable[Constraint]:
    for head in stated[SHACL.xone]:
        members = _members(shapes, head, depth)
        yield Constraint(SHACL.XoneConstraintComponent, _one_of(members), _conforming(members, 1))


def _one_of(members: Sequence[Shape]) -> Expectation:
    return lambda: shortened("just one of: " + "; ".join(shape.expected() for shape in members))


def _or(shapes: Shapes, stated: Statements, depth: int) -> Iterable[Constraint]:
    for head in stated[SHACL.or_]:
        members = _members(shapes, head, depth)
        expected = _joined(members, " or ")
        required = [shapes.requires(shape) for shape in members] if len(members) >= _FEWEST_BRANCHES else [{}]
        common = [predicate for predicate in required[0] if all(predicate in each for each in required)]
        if common:
            terms = [each[common[0]] for each in required]
            yield _switch(members, common[0], terms, expected)
        else:
            yield Either(SHACL.OrConstraintComponent, expected, _conforming_to_any(members), members)


def _conforming_to_any(members: tuple[Shape, ...]) -> Callable[[Data, Term], bool]:
    def holds(data: Data, value: Term) -> bool:
        for shape in members:  # noqa: SIM110 - any() is twice as slow for a short test
            if shape.conforms(data, value):
                return True
        return False

    return holds


def _switch(
    members: tuple[Shape, ...], predicate: NamedNode, required: Iterable[Iterable[Term]], expected: Expectation
) -> Switch:
    """Return the switch of ``members``, each of which requires one of some terms as value of the predicate."""
    table: dict[Term, tuple[Shape, ...]] = {}
    for shape, terms in zip(members, required, strict=True):
        for term in terms:
            table[term] = (*table.get(term, ()), shape)

    def holds(data: Data, value: Term) -> bool:
        return any(s.conforms(data, value) for term in data.objects(value, predicate) for s in table.get(term, ()))

    return Switch(SHACL.OrConstraintComponent, expected, holds, predicate=predicate, table=table)


COUNTS: Mapping[NamedNode, Callable[[Shapes, Statements, int], Iterable[Count]]] = {
    SHACL.minCount: _min_count,
    SHACL.maxCount: _max_count,
    SHACL.hasValue: _has_value,
    SHACL.qualifiedValueShape: _qualified,
}
EACH: Mapping[NamedNode, Callable[[Shapes, Statements, int], Iterable[Constraint]]] = {
    SHACL.datatype: _datatype,
    SHACL.nodeKind: _node_kind,
    SHACL.class_: _class,
    SHACL.in_: _in,
    SHACL.minInclusive: _limit(SHACL.minInclusive, SHACL.MinInclusiveConstraintComponent, ge, "at least"),
    SHACL.minExclusive: _limit(SHACL.minExclusive, SHACL.MinExclusiveConstraintComponent, gt, "more than"),
    SHACL.maxInclusive: _limit(SHACL.maxInclusive, SHACL.MaxInclusiveConstraintComponent, le, "at most"),
    SHACL.maxExclusive: _limit(SHACL.maxExclusive, SHACL.MaxExclusiveConstraintComponent, lt, "less than"),
    SHACL.minLength: _min_length,
    SHACL.maxLength: _max_length,
    SHACL.pattern: _pattern,
    SHACL.languageIn: _language_in,
    SHACL.node: _node,
    SHACL.not_: _not,
    SHACL.and_: _and,
    SHACL.or_: _or,
    SHACL.xone: _xone,
}
