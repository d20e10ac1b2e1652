"""The components of a robot as a whole: what each has, its own vocabulary, and what is left over in a body."""

from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, Triple

from component_schemas import NAMES, ROBOT
from linked_fleet_agent.wire.components import Component
from linked_fleet_agent.wire.schema import MAX_MEMBERS
from linked_fleet_gateway.extensions.components.declarations import CompiledDeclarations, compile_declarations
from linked_fleet_gateway.extensions.components.places import Place, place_of, term_iri
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import HYBRIT, MATHS, OWL, QUDT, RDF, RDFS

WIDTH = {"type": "number", "unit": "M", "minimum": 0, "maximum": 0.08, "title": "Width", "description": "Between."}
HOLDS = "https://example.org/terms#holds"
GRIPPER: dict[str, Any] = {
    "name": "gripper",
    "properties": {
        "width": {"schema": WIDTH, "writable": True},
        "holds": {"schema": {"type": "boolean", "@type": HOLDS}},
    },
    "actions": {
        "grasp": {
            "input": {"type": "object", "properties": {"force": {"type": "number", "unit": "N"}}},
            "feedback": WIDTH,
            "result": {"type": "object", "properties": {"left": {"type": "integer"}, "right": {"type": "integer"}}},
        },
        "open": {},
    },
    "events": {"lost": {"data": {"type": "array", "items": {"type": "string"}}}, "told": {}},
}
FOCUS = NamedNode(f"{ROBOT}gripper/actions/grasp")
_RDFS = RDFS.extended("range isDefinedBy")
_QUDT = QUDT.extended("minInclusive maxInclusive")


def compiled(*declared: dict[str, Any]) -> CompiledDeclarations:
    return compile_declarations([msgspec.convert(each, Component) for each in declared], ROBOT)


def own(name: str) -> NamedNode:
    return NamedNode(f"{ROBOT}vocabulary#{name}")


def test_each_part_has_its_places() -> None:
    gripper = compiled(GRIPPER).components["gripper"]
    assert {name: each.predicate for name, each in gripper.properties.items()} == {
        "width": own("gripper-property-width"), "holds": NamedNode(HOLDS),
    }  # fmt: skip
    grasp, open_ = gripper.actions["grasp"], gripper.actions["open"]
    assert grasp.feedback is not None
    assert grasp.result is not None
    assert set(grasp.result.members) == {"left", "right"}
    assert (open_.feedback, open_.result, gripper.events["told"].data) == (None, None, None)
    assert gripper.events["lost"].data is not None


def test_an_action_without_input_takes_an_empty_body_alone() -> None:
    taken = compiled(GRIPPER).components["gripper"].actions["open"].input
    assert taken.read([], FOCUS) == ({}, None)
    value, refusal = taken.read([Triple(FOCUS, own("x"), Literal(1))], FOCUS)
    assert value is None
    assert refusal is not None


def test_a_property_that_can_be_set_takes_its_value_in_its_unit() -> None:
    taken = compiled(GRIPPER).components["gripper"].properties["width"].input
    graph = Graph()
    taken.describe(graph, FOCUS, 0.05)
    assert taken.read(graph.triples, FOCUS) == (0.05, None)
    graph = Graph()
    taken.describe(graph, FOCUS, 0.09)
    _, refusal = taken.read(graph.triples, FOCUS)
    assert refusal is not None
    assert "0.08" in refusal[0]


def test_what_a_body_says_beside_the_value_is_left_over() -> None:
    width = compiled(GRIPPER).components["gripper"].properties["width"].input
    graph = Graph()
    width.describe(graph, FOCUS, 0.05)
    more = [Triple(FOCUS, RDFS.label, Literal("mine")), Triple(NamedNode(HOLDS), RDFS.label, Literal("other"))]
    assert width.unused(graph.triples, FOCUS) == []
    assert width.unused([*graph.triples, *more], FOCUS) == more


def vocabulary(*declared: dict[str, Any]) -> list[Triple]:
    graph = Graph()
    compiled(*declared).describe_vocabulary(graph)
    return graph.triples


def test_the_vocabulary_describes_the_own_terms_and_no_others() -> None:
    said = vocabulary(GRIPPER)
    terms = {each.subject for each in said if each.predicate == RDF.type and each.object == RDF.Property}
    assert terms == {
        own("gripper-property-width"), own("gripper-input-grasp-force"), own("gripper-result-grasp-left"),
        own("gripper-result-grasp-right"), own("gripper-event-lost"), own("gripper-event-told"),
    }  # fmt: skip
    width = own("gripper-property-width")
    assert Triple(NamedNode(f"{ROBOT}vocabulary"), RDF.type, OWL.Ontology) in said
    for predicate, value in (
        (RDFS.label, Literal("Width")),
        (RDFS.comment, Literal("Between.")),
        (_RDFS.range, HYBRIT.Property),
        (_RDFS.isDefinedBy, NamedNode(f"{ROBOT}vocabulary")),
    ):
        assert Triple(width, predicate, value) in said
    assert Triple(own("gripper-input-grasp-force"), _RDFS.range, MATHS.Scalar) in said
    limits = {each.predicate: float(each.object.value) for each in said if each.subject == width and "Inclusive" in
              str(each.predicate) and isinstance(each.object, Literal)}  # fmt: skip
    assert limits == {_QUDT.minInclusive: 0.0, _QUDT.maxInclusive: 0.08}
    assert not any(each.subject == NamedNode(HOLDS) for each in said)


def test_two_members_with_one_term_have_own_terms_that_stand_for_it() -> None:
    twice = {"schema": {"type": "boolean", "@type": HOLDS}}
    said = vocabulary({"name": "box", "properties": {"a": twice, "b": twice}})
    stands_for = RDFS.extended("subPropertyOf").subPropertyOf
    for name in ("a", "b"):
        assert Triple(own(f"box-property-{name}"), stands_for, NamedNode(HOLDS)) in said


def _terms(place: Place) -> list[str]:
    return [place.term.value, *(each for member in place.members.values() for each in _terms(member))]


@given(st.sets(st.tuples(*[st.sampled_from([*NAMES, "a-b-c", "ä", "%41"])] * 2), min_size=2, max_size=30))
def test_no_two_parts_share_a_term(names: set[tuple[str, str]]) -> None:
    made = [term_iri(ROBOT, component, "input", name) for component, name in names]
    assert len(set(made)) == len(made)


@pytest.mark.parametrize("deep", [1, 2])
def test_members_of_members_have_terms_of_their_own(deep: int) -> None:
    inner: dict[str, Any] = {"type": "boolean"}
    for _ in range(deep):
        inner = {"type": "object", "properties": {"a": inner, "a-a": {"type": "boolean"}}}
    schema = msgspec.convert({"name": "x", "properties": {"p": {"schema": inner}}}, Component).properties["p"].schema
    terms = _terms(place_of(schema, term_iri(ROBOT, "x", "property", "p")))
    assert len(set(terms)) == len(terms) == 1 + 2 * deep


def test_nothing_is_compiled_before_it_is_used() -> None:
    grasp = compiled(GRIPPER).components["gripper"].actions["grasp"]
    assert "validator" not in vars(grasp.input)
    assert grasp.input.validator is grasp.input.validator


class Body(list[Triple]):
    """A body that counts how often it is looked through."""

    passes = 0

    def __iter__(self) -> Iterator[Triple]:
        self.passes += 1
        return super().__iter__()


def _passes(members: int) -> int:
    """Return how often a body of so many members is looked through until it is judged."""
    numbers = {f"m{number}": WIDTH for number in range(members)}
    acting = compiled({"name": "a", "actions": {"act": {"input": {"type": "object", "properties": numbers}}}})
    taken, graph = acting.components["a"].actions["act"].input, Graph()
    taken.describe(graph, FOCUS, dict.fromkeys(numbers, 0.05))
    body = Body(graph.triples)
    assert taken.read(body, FOCUS) == (dict.fromkeys(numbers, 0.05), None)
    assert taken.unused(body, FOCUS) == []
    return body.passes


def test_a_body_of_many_members_is_looked_through_as_often_as_one_of_few() -> None:
    """Clients choose both the number of members and the size of the body."""
    assert _passes(MAX_MEMBERS) == _passes(1)
