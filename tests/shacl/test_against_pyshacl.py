"""Compiled shapes find what pySHACL finds, for any shape and body; exceptions are in test_exceptions.py."""

from collections.abc import Iterable, Sequence
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_rdf.graph import Graph, integer
from linked_fleet_rdf.shapes import load_turtle
from linked_fleet_rdf.vocabulary import HYBRIT, LF, VOM, XSD
from linked_fleet_shacl import compile_graph
from linked_fleet_shacl.check import MOST
from linked_fleet_shacl.terms import RDF, RDFS, SHACL, Node, Term
from properties import examples
from shacl_findings import EX, compiled_finds, pyshacl_finds, pyshacl_reports, reported, to_rdflib, turtle


def _literal(text: str, datatype: NamedNode) -> Literal:
    return Literal(text, datatype=datatype)


_INTEGERS = [
    XSD.integer, XSD.int, XSD.long, XSD.short, XSD.byte, XSD.nonNegativeInteger, XSD.positiveInteger,
    XSD.nonPositiveInteger, XSD.negativeInteger, XSD.unsignedLong, XSD.unsignedInt, XSD.unsignedShort, XSD.unsignedByte,
]  # fmt: skip
_FLOATS = [XSD.float, XSD.double]
_WHOLE = ["0", "1", "-1", "+3", "-0", "007", "127", "128", "255", "256", "-129", "65536", "2147483648",
          "9" * 4096, "-" + "7" * 4096, str(2**63), str(-(2**31))]  # fmt: skip
_FRACTIONS = [
    "0.1",
    "1.",
    ".5",
    "-2.5",
    "0.1000000000000000055511151231257827021181583404541015625",
    "3.0",
    "-." + "3" * 4096,
]
_POWERS = ["1e0", "1E-1", "2.5e3", "1e400", "-1e400", "1e-400", "INF", "-INF", "NaN", "1e" + "9" * 30]
_ILL = ["", "abc", "1,5", "--1", "1e", "0x1", "1 2", "true", "."]
_numbers = st.one_of(
    st.builds(_literal, st.sampled_from(_WHOLE), st.sampled_from([*_INTEGERS, XSD.decimal, *_FLOATS])),
    st.builds(_literal, st.sampled_from(_FRACTIONS), st.sampled_from([XSD.decimal, *_FLOATS])),
    st.builds(_literal, st.sampled_from(_POWERS), st.sampled_from(_FLOATS)),
    st.builds(_literal, st.integers(-5, 300).map(str), st.sampled_from([*_INTEGERS, XSD.decimal, *_FLOATS])),
)
_others = st.one_of(
    st.builds(_literal, st.sampled_from(_ILL), st.sampled_from([*_INTEGERS, XSD.decimal, *_FLOATS])),
    st.builds(_literal, st.sampled_from(["true", "false", "1", "0", "TRUE", "yes", ""]), st.just(XSD.boolean)),
    st.builds(
        _literal, st.sampled_from(["", "x", "http://x.org/"]), st.sampled_from([XSD.string, XSD.anyURI, EX.type])
    ),
    st.builds(_literal, st.sampled_from(["2026-01-01T00:00:00Z", "soon"]), st.just(XSD.dateTime)),
    st.sampled_from([Literal("x", language="en"), Literal("x", language="de"), Literal("43.6"), Literal("abc\n")]),
)
_blanks = st.sampled_from([BlankNode("b1"), BlankNode("b2"), BlankNode("b3")])
_iris = st.sampled_from([EX.body, EX.a, EX.b, EX.C, EX.D])
_predicates = st.sampled_from([EX.p, EX.q, EX.r])
_nodes = st.one_of(st.just(EX.body), st.just(EX.body), _blanks, _iris)
_terms = st.one_of(_numbers, _others, _blanks, _iris, st.just(integer(1)))
_types = st.builds(Triple, _nodes, st.just(RDF.type), st.sampled_from([EX.C, EX.D]))
_subclasses = st.builds(Triple, st.sampled_from([EX.C, EX.D]), st.just(RDFS.subClassOf), st.sampled_from([EX.C, EX.D]))
_statements = st.builds(Triple, _nodes, _predicates, _terms)
_bodies = st.lists(st.one_of(_statements, _statements, _types, _subclasses), max_size=14)

_fixed = st.one_of(_iris, _numbers, _others, st.just(integer(1)))
_bounds = _numbers.filter(lambda t: not to_rdflib(t).ill_typed and t.value != "NaN")
_leaves = st.one_of(
    st.tuples(st.just(SHACL.datatype), st.sampled_from([*_INTEGERS, XSD.decimal, *_FLOATS, XSD.boolean, XSD.string,
                                                        XSD.anyURI, EX.type, RDF.langString])),
    st.tuples(st.just(SHACL.nodeKind), st.sampled_from([SHACL.IRI, SHACL.BlankNode, SHACL.Literal, SHACL.BlankNodeOrIRI,
                                                        SHACL.BlankNodeOrLiteral, SHACL.IRIOrLiteral])),
    st.tuples(st.just(SHACL.deactivated), st.booleans().map(Literal)),
    st.tuples(st.just(SHACL.class_), st.sampled_from([EX.C, EX.D])),
    st.tuples(st.just(SHACL.in_), st.lists(_fixed, max_size=4)),
    st.tuples(st.just(SHACL.hasValue), _fixed),
    st.tuples(st.sampled_from([SHACL.minInclusive, SHACL.minExclusive]), _bounds),
    st.tuples(st.sampled_from([SHACL.maxInclusive, SHACL.maxExclusive]), _bounds),
    st.tuples(st.sampled_from([SHACL.minLength, SHACL.maxLength]), st.integers(0, 3).map(integer)),
    st.tuples(st.just(SHACL.languageIn), st.lists(st.sampled_from(["en", "DE"]).map(Literal), min_size=1, max_size=2)),
    st.tuples(st.sampled_from([SHACL.equals, SHACL.disjoint]), _predicates),
    st.tuples(st.just(SHACL.closed), st.lists(st.sampled_from([EX.p, RDF.type]), max_size=2)),
    st.tuples(st.just(SHACL.pattern), st.sampled_from(["^x", "[0-9]$", "", "HTTP"]).map(Literal)),
)  # fmt: skip
_paths = st.recursive(
    _predicates,
    lambda inner: st.one_of(
        st.tuples(st.just(None), st.lists(inner, min_size=2, max_size=3)),
        st.tuples(st.just(SHACL.alternativePath), st.lists(inner, min_size=2, max_size=3)),
        st.tuples(st.sampled_from([SHACL.zeroOrMorePath, SHACL.oneOrMorePath, SHACL.zeroOrOnePath]), inner),
        st.tuples(st.just(SHACL.inversePath), _predicates),
    ),
    max_leaves=3,
)
_counts = st.one_of(
    st.tuples(st.sampled_from([SHACL.minCount, SHACL.maxCount]), st.integers(0, 2).map(integer)),
    st.tuples(st.just(SHACL.uniqueLang), st.booleans().map(Literal)),
)


class _Property(tuple[object, ...]):
    """A property shape: its path and its constraints."""


def _shapes(depth: int) -> st.SearchStrategy[object]:
    """Return a strategy for a node shape's constraints: pairs of parameter and value, nested up to ``depth``."""
    if depth == 0:
        return st.lists(_leaves, min_size=1, max_size=2)
    node, prop = _shapes(depth - 1), _properties(depth - 1)
    member = st.one_of(node, prop)
    nested = st.one_of(
        st.tuples(st.sampled_from([SHACL.or_, SHACL.and_, SHACL.xone]), st.lists(member, min_size=1, max_size=4)),
        st.tuples(st.just(SHACL.or_), st.lists(_choice(prop), min_size=4, max_size=6)),
        st.tuples(st.just(SHACL.not_), member),
        st.tuples(st.just(SHACL.node), node),
        st.tuples(st.just(SHACL.property), prop),
        st.tuples(st.just(SHACL.property), prop),
    )
    return st.lists(st.one_of(_leaves, nested, nested), min_size=1, max_size=3)


def _properties(depth: int) -> st.SearchStrategy[object]:
    qualified = st.tuples(
        st.just(SHACL.qualifiedValueShape), st.lists(_leaves, min_size=1, max_size=2), st.integers(0, 2)
    )
    constraints = st.tuples(_shapes(depth), st.lists(_counts, max_size=2), st.lists(qualified, max_size=1))
    return st.builds(lambda path, all_: _Property((path, [c for some in all_ for c in some])), _paths, constraints)


def _choice(prop: st.SearchStrategy[object]) -> st.SearchStrategy[object]:
    """Return a strategy for a branch of sh:or that applies to nodes with a certain value."""
    by_value = st.builds(lambda v: _Property((EX.p, [(SHACL.hasValue, v)])), st.sampled_from([EX.a, EX.b, integer(1)]))
    by_list = st.builds(
        lambda vs: _Property((EX.p, [(SHACL.in_, vs), (SHACL.minCount, integer(1))])), st.lists(_iris, max_size=2)
    )
    return st.builds(
        lambda key, rest: [(SHACL.property, key), (SHACL.property, rest)], st.one_of(by_value, by_list), prop
    )


_SINGLE = (SHACL.deactivated, SHACL.closed, SHACL.uniqueLang, SHACL.languageIn, SHACL.datatype, SHACL.nodeKind,
           SHACL.in_, SHACL.minLength, SHACL.maxLength, SHACL.minCount, SHACL.maxCount)  # fmt: skip


def _add_shape(graph: Graph, shape: object, node: Node | None = None) -> Node:
    node = node or graph.blank()
    constraints: Sequence[tuple[object, ...]] = shape  # type: ignore[assignment]
    if isinstance(shape, _Property):
        path, constraints = shape  # type: ignore[assignment]
        graph.add(node, SHACL.path, _add_path(graph, path))
    seen = set()
    for parameter, value, *count in constraints:
        assert isinstance(parameter, NamedNode)
        if parameter in _SINGLE and parameter in seen:
            continue
        seen.add(parameter)
        if parameter == SHACL.closed:
            graph.add(node, SHACL.ignoredProperties, graph.collection(value))  # type: ignore[arg-type]
        graph.add(node, parameter, Literal(True) if parameter == SHACL.closed else _add_value(graph, parameter, value))
        if count:
            graph.add(node, SHACL.qualifiedMinCount, integer(count[0]))  # type: ignore[arg-type]
            graph.add(node, SHACL.qualifiedMaxCount, integer(1))
    return node


def _add_value(graph: Graph, parameter: NamedNode, value: object) -> Term:
    if parameter in (SHACL.or_, SHACL.and_, SHACL.xone):
        return graph.collection([_add_shape(graph, each) for each in value])  # type: ignore[attr-defined]
    if parameter in (SHACL.node, SHACL.not_, SHACL.property, SHACL.qualifiedValueShape):
        return _add_shape(graph, value)
    return graph.collection(value) if parameter in (SHACL.in_, SHACL.languageIn) else value  # type: ignore[arg-type, return-value]


def _add_path(graph: Graph, path: Any) -> Node:
    if isinstance(path, NamedNode):
        return path
    kind, inner = path
    added = [_add_path(graph, each) for each in inner] if isinstance(inner, list) else _add_path(graph, inner)
    if kind is None:
        return graph.collection(added)  # type: ignore[arg-type]
    node = graph.blank()
    graph.add(node, kind, graph.collection(added) if isinstance(added, list) else added)  # type: ignore[arg-type]
    return node


@settings(max_examples=examples(400), suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
@given(_shapes(3), _bodies)
def test_any_shape_finds_in_any_body_what_pyshacl_finds(shape: object, body: list[Triple]) -> None:
    """The same verdict, and the same focus, path, value and component of every result."""
    graph = Graph()
    _add_shape(graph, shape, EX.Shape)
    assert compiled_finds(graph.triples, EX.Shape, body, EX.body) == pyshacl_finds(
        graph.triples, EX.Shape, body, EX.body
    )


# --- every edge of the simple constraints, which chance would miss ---

_EDGES = [*_WHOLE, *_FRACTIONS, *_POWERS, *_ILL, "-128", "32767", "32768", "65535", "2147483647", "4294967295",
          "4294967296", "-2147483649", "-32768", "-32769", "5", "5.0", "5.5", "5e0", "5.5e0", "+INF"]  # fmt: skip


_DATES = ["2026-01-31", "2024-02-29", "2023-02-29", "2000-02-29", "1900-02-29", "2026-02-30", "2026-04-31",
          "2026-13-01", "2026-00-01", "2026-01-00", "2026-1-1", "26-01-01", "soon", ""]  # fmt: skip
_TIMES = ["2026-01-01T00:00:00", "2026-01-01T23:59:59.999Z", "2026-01-01T12:00:00+14:00", "2024-02-29T12:00:00-05:30",
          "2023-02-29T00:00:00Z", "2026-01-01T24:00:01", "2026-01-01T12:60:00", "2026-01-01T25:00:00",
          "T00:00:00", "2026-01-01T"]  # fmt: skip


def _edges(texts: Iterable[str], kinds: Iterable[NamedNode]) -> list[Literal]:
    """Return all forms in all types, except decimals with an exponent and the like, which only Python parses."""
    return [
        _literal(text, kind) for kind in kinds for text in texts if kind != XSD.decimal or not set(text) & set("eEN")
    ]


_KINDS = (XSD.integer, XSD.byte, XSD.decimal, XSD.float, XSD.double, XSD.string, XSD.boolean)
_OF_ALL_TYPES = _edges(("5", "5.5", "4", "6", "300", "NaN", "INF", "x"), _KINDS)
_ANY = [*_OF_ALL_TYPES[::3], EX.a, EX.b, BlankNode("b1"), Literal(""), Literal("abc"), Literal("ABC", language="en"),
        *(_literal(text, XSD.boolean) for text in ("true", "false", "1", "0", "TRUE", "False"))]  # fmt: skip
_TAGGED = [Literal(text, language=tag) for tag in ("en", "en-gb", "fr", "EN", "eng") for text in ("x", "y")]
_LIMITS = (SHACL.minInclusive, SHACL.minExclusive, SHACL.maxInclusive, SHACL.maxExclusive)
_BOUNDS = [integer(5), *(_literal("5.5", kind) for kind in (XSD.decimal, XSD.double)), _literal("INF", XSD.float),
           _literal("5.5e0", XSD.float), _literal("6", XSD.byte), _literal("4", XSD.decimal)]  # fmt: skip
_SIMPLE: list[tuple[tuple[tuple[NamedNode, object], ...], Sequence[Term]]] = [
    *((((SHACL.datatype, kind),), _edges(_EDGES, [kind])) for kind in [*_INTEGERS, XSD.decimal, *_FLOATS]),
    (((SHACL.datatype, XSD.dateTime),), _edges(_TIMES, [XSD.dateTime])),
    (((SHACL.datatype, NamedNode(XSD.iri + "date")),), _edges(_DATES, [NamedNode(XSD.iri + "date")])),
    *((((limit, bound),), _OF_ALL_TYPES) for limit in _LIMITS for bound in _BOUNDS),
    *((((SHACL.datatype, kind),), _ANY) for kind in (XSD.string, XSD.boolean, XSD.anyURI, RDF.langString)),
    *((((length, integer(n)),), _ANY) for length in (SHACL.minLength, SHACL.maxLength) for n in (0, 1, 3, 4)),
    *((((parameter, EX.a),), _ANY) for parameter in (SHACL.hasValue, SHACL.class_)),
    (((SHACL.pattern, Literal("^a")),), _ANY),
    (((SHACL.pattern, Literal("^a")), (SHACL.flags, Literal("i"))), _ANY),
    *((((SHACL.nodeKind, SHACL.terms[kind]),), _ANY) for kind in ("IRI", "BlankNode", "Literal")),
    *((((SHACL.nodeKind, SHACL.terms[f"{kind}Literal"]),), _ANY) for kind in ("BlankNodeOr", "IRIOr")),
    (((SHACL.nodeKind, SHACL.BlankNodeOrIRI),), _ANY),
    *((((several, [[(SHACL.nodeKind, SHACL.IRI)], [(SHACL.in_, [EX.a])]]),), _ANY)
      for several in (SHACL.xone, SHACL.and_, SHACL.or_)),
    *((((SHACL.languageIn, [Literal(tag)]),), [*_ANY, *_TAGGED]) for tag in ("en", "EN-gb", "*", "")),
    (((SHACL.uniqueLang, Literal(True)),), _TAGGED[:3]),
    (((SHACL.uniqueLang, Literal(True)),), [*_TAGGED, *_ANY[-8:]]),
    (((SHACL.uniqueLang, Literal(False)),), _TAGGED),
    *((((SHACL.minCount, integer(n)),), _ANY[:2]) for n in (0, 1, 2, 3)),
    *((((SHACL.maxCount, integer(n)),), _ANY[:2]) for n in (0, 1, 2, 3)),
    *((((SHACL.qualifiedValueShape, [(SHACL.nodeKind, SHACL.IRI)], n),), values) for n in (0, 1, 2)
      for values in ([], [EX.a], [EX.a, EX.b], [EX.a, EX.b, Literal("")])),
]  # fmt: skip


@pytest.mark.parametrize(("constraints", "values"), _SIMPLE)
def test_a_simple_constraint_finds_what_pyshacl_finds(
    constraints: tuple[tuple[NamedNode, object], ...], values: Sequence[Term]
) -> None:
    """On both sides of every limit and in every lexical form; a few values at a time, as a report is limited."""
    graph = Graph()
    _add_shape(graph, [(SHACL.property, _Property((EX.p, constraints)))], EX.Shape)
    for start in range(0, len(values) or 1, MOST):
        body = [Triple(EX.body, EX.p, value) for value in values[start : start + MOST]]
        expected = pyshacl_finds(graph.triples, EX.Shape, body, EX.body)
        assert compiled_finds(graph.triples, EX.Shape, body, EX.body) == expected


# --- shapes that are in use ---

_NUMBER = "[ sh:datatype xsd:float ] [ sh:datatype xsd:double ] [ sh:datatype xsd:decimal ] [ sh:datatype xsd:integer ]"
_ROTATE = """ex:Shape a sh:NodeShape ; sh:targetClass maths:Scalar ;
    sh:property [ sh:path vom:numericalValue ; sh:name "value" ; sh:minCount 1 ; sh:maxCount 1 ; sh:or ( %s ) ] ;
    sh:property [ sh:path vom:unit ; sh:name "unit" ; sh:minCount 1 ; sh:maxCount 1 ;
                  sh:in ( vom:Degree maths:Degree vom:Radian maths:Radian ) ] ;
    sh:or ( [ sh:property [ sh:path vom:unit ; sh:in ( vom:Degree maths:Degree ) ] ,
                          [ sh:path vom:numericalValue ; sh:minInclusive %s ; %s %s ] ]
            [ sh:property [ sh:path vom:unit ; sh:in ( vom:Radian maths:Radian ) ] ,
                          [ sh:path vom:numericalValue ; sh:minInclusive %s ; %s %s ] ] ) ."""
_REVOLUTE = (_NUMBER, "-123.01403", "sh:maxInclusive", "59.988681", "-2.147", "sh:maxInclusive", "1.047")
_CONTINUOUS = (_NUMBER, "0.0", "sh:maxExclusive", "360.0", "0.0", "sh:maxExclusive", "6.283185")
_units = st.sampled_from([VOM.Degree, VOM.Radian, EX.a, BlankNode("b1"), Literal("deg")])
_values = st.one_of(_numbers, _others, st.floats(-7, 7).map(lambda v: Literal(repr(v), datatype=XSD.double)))


@pytest.mark.parametrize("limits", [_REVOLUTE, _CONTINUOUS])
@settings(max_examples=examples(80))
@given(st.lists(_values, max_size=2), st.lists(_units, max_size=2))
def test_the_shape_of_an_action_finds_what_pyshacl_finds(
    limits: tuple[str, ...], values: list[Term], units: list[Term]
) -> None:
    """For a joint with limits and one without, whatever is stated about value and unit."""
    shapes = turtle(_ROTATE % limits)
    body = [Triple(EX.body, VOM.numericalValue, v) for v in values] + [Triple(EX.body, VOM.unit, u) for u in units]
    assert compiled_finds(shapes, EX.Shape, body, EX.body) == pyshacl_finds(shapes, EX.Shape, body, EX.body)


def _targets(graph: Graph, joints: int) -> Node:
    """Any positive number of targets, each for one of the joints and within its limits."""
    shape, target = graph.blank(), graph.blank()
    graph.add(shape, SHACL.property, target)
    graph.add(target, SHACL.path, LF.target)
    graph.add(target, SHACL.minCount, integer(1))
    graph.add(target, SHACL.or_, graph.collection([_target(graph, number) for number in range(joints)]))
    return shape


def _target(graph: Graph, number: int) -> Node:
    branch, joint, unit, value = (graph.blank() for _ in range(4))
    graph.add(branch, SHACL.property, joint, unit, value)
    for node, path in ((joint, LF.ofJoint), (unit, VOM.unit), (value, VOM.numericalValue)):
        graph.add(node, SHACL.path, path)
        graph.add(node, SHACL.minCount, integer(1))
        graph.add(node, SHACL.maxCount, integer(1))
    graph.add(joint, SHACL.hasValue, NamedNode(f"http://example.org/{number}"))
    graph.add(unit, SHACL.in_, graph.collection([VOM.Radian]))
    graph.add(value, SHACL.minInclusive, _literal("-1.5", XSD.decimal))
    graph.add(value, SHACL.maxInclusive, _literal(f"{number}.5", XSD.decimal))
    return branch


_stated_targets = st.lists(
    st.tuples(_blanks, st.integers(0, 17), st.lists(_units, max_size=2), st.lists(_values, max_size=2)), max_size=5
)


@settings(max_examples=examples(60))
@given(_stated_targets)
def test_a_shape_of_many_targets_finds_what_pyshacl_finds(
    targets: list[tuple[BlankNode, int, list[Term], list[Term]]],
) -> None:
    """Targets of unknown joints, of two joints, without unit, out of limits, and the same node twice."""
    graph = Graph()
    shape = _targets(graph, 15)
    body = []
    for node, number, units, values in targets:
        body += [Triple(EX.body, LF.target, node), Triple(node, LF.ofJoint, NamedNode(f"http://example.org/{number}"))]
        body += [Triple(node, VOM.unit, u) for u in units] + [Triple(node, VOM.numericalValue, v) for v in values]
    assert compiled_finds(graph.triples, shape, body, EX.body) == pyshacl_finds(graph.triples, shape, body, EX.body)


_subscription = st.one_of(
    st.tuples(st.just(RDF.type), st.sampled_from([HYBRIT.Subscription, HYBRIT.WebCallback, LF.Stream, LF.EventStream])),
    st.tuples(st.just(HYBRIT.onResource), _iris),
    st.tuples(st.sampled_from([HYBRIT.callbackURL, HYBRIT.callbackUrl]), st.sampled_from([
        Literal("HTTPS://x.org/a"), Literal("ftp://x.org"), _literal("http://x.org/", XSD.anyURI), EX.a])),
    # Not longer than what a report repeats.
    st.tuples(st.sampled_from([LF.minimumInterval, LF.deadband]), _values.filter(lambda v: len(v.value) <= 1024)),
    st.tuples(st.just(LF.depth), st.sampled_from([LF.thisAlone, LF.unknown])),
    st.tuples(st.sampled_from([LF.secret, HYBRIT.mediaType]), st.sampled_from([Literal("whsec_a"), integer(1)])),
)  # fmt: skip


@settings(max_examples=examples(100))
@given(st.lists(_subscription, max_size=8))
def test_the_shapes_of_subscriptions_find_what_pyshacl_finds(stated: list[tuple[NamedNode, Term]]) -> None:
    """Handwritten shapes that share parts, with alternative paths; also found by the targets of all together."""
    by_subject = load_turtle("subscriptions.ttl")
    triples = [triple for about in by_subject.values() for triple in about]
    body = [Triple(EX.body, predicate, value) for predicate, value in stated]
    shape = LF.SubscriptionShape
    assert compiled_finds(triples, shape, body, EX.body) == pyshacl_finds(triples, shape, body, EX.body)
    assert reported(compile_graph(triples), body) == pyshacl_reports(triples, body)
