"""The client with a server that names everything differently: it works by links, types and shapes only."""

from collections.abc import Iterator
from typing import Any

import pytest
import rdflib
from rdflib import RDF, Namespace, URIRef

from linked_fleet_client.action import Action
from linked_fleet_client.errors import InvalidInput, NoSuchThing, Problem, StillRunning, Unsupported
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.invocation import Invocation

EX = Namespace("https://example.org/ns#")
VOM = Namespace("http://vocab.arvida.de/2015/06/vom/vocab#")
UNIT = Namespace("http://qudt.org/vocab/unit/")


@pytest.fixture
def fleet(other_tree: Any) -> Iterator[Fleet]:
    with Fleet(other_tree.root) as fleet:
        yield fleet


@pytest.fixture
def elbow(fleet: Fleet) -> Thing:
    return fleet["cell"]["lefty"]["Elbow"]


@pytest.fixture
def bend(elbow: Thing) -> Action:
    return elbow.actions["Bend"]


def body_of(sent: bytes) -> rdflib.Graph:
    return rdflib.Graph().parse(data=sent, format="turtle")


def test_things_are_found_by_links_and_names(fleet: Fleet) -> None:
    """By an identifier in the thing's own description, over a redirect, a Link field, a query and a fragment."""
    assert fleet.title == "Hall 7"
    arm = fleet["cell"]["lefty"]
    assert arm["elbow"].kind == "Hinge"
    assert arm["Two fingers"].kind == "Gripper"
    assert arm["gripper"].iri == arm["Two fingers"].iri
    assert [thing.name for thing in list(fleet.walk())] == ["Hall 7", "cell", "lefty", "Elbow", "Two fingers"]


def test_a_path_is_names(fleet: Fleet) -> None:
    assert fleet.at("cell/The left arm/Elbow/angle").iri.endswith("/v/aa1")
    assert isinstance(fleet.at("cell/lefty/elbow/bend"), Action)


def test_an_unknown_name_is_reported_with_the_valid_ones(fleet: Fleet) -> None:
    with pytest.raises(NoSuchThing, match="Elbow"):
        fleet["cell"]["lefty"]["Elbwo"]


def test_a_property_is_found_by_its_type_and_named_by_its_predicate(elbow: Thing) -> None:
    angle = elbow.properties["angle"].value
    assert (angle.number, angle.unit_label) == (12.5, "deg")
    assert angle.time is not None
    assert angle.time.isoformat() == "2026-11-21T10:00:00+00:00"
    radians = angle.to("rad").number
    assert radians == pytest.approx(0.2181662)


def test_unknown_is_none(elbow: Thing) -> None:
    load = elbow.properties["load"].value
    assert (load.number, str(load)) == (None, "unknown N")


def test_an_unknown_form_is_shown_as_statements(elbow: Thing) -> None:
    mood = elbow.properties["mood"]
    with pytest.raises(Unsupported):
        _ = mood.value
    assert (EX.colour, rdflib.Literal("blue")) in mood.triples


def test_a_shape_in_other_documents_is_read(bend: Action, elbow: Thing) -> None:
    """Nested fields, with limits for each unit and axis."""
    goal, mode, tries = sorted(bend.fields, key=lambda each: each.name)
    assert (goal.min_count, goal.max_count, goal.required) == (1, 2, True)
    assert mode.choices is not None
    assert ([str(choice) for choice in mode.choices], mode.required) == (["soft", "hard"], False)
    assert (tries.limits[0].lower, tries.limits[0].upper) != (None, None)
    axis, unit, value = sorted(goal.fields, key=lambda each: each.name)
    assert axis.choices is not None
    assert elbow.iri in axis.choices
    assert unit.choices == (UNIT.DEG, UNIT.RAD, UNIT.MilliM)
    assert [limits.upper.value for limits in value.limits if limits.upper] == [90, 1.57, 40]
    assert value.limits[0].when == {"axis": (elbow.iri,), "unit": (UNIT.DEG,)}


def test_a_nested_body_is_built_and_conforms(bend: Action, elbow: Thing) -> None:
    """A thing, a name and an IRI all select the axis; a unit that is not offered is converted."""
    fingers = str(elbow.owner["Two fingers"].iri)  # type: ignore[index]
    body = bend.build(goal=[{"axis": "Elbow", "value": 0.125, "unit": "turn"}], tries=2)
    assert {float(each) for each in body.objects(None, VOM.numericalValue)} == {45.0}
    body = bend.build(goal=[{"axis": elbow, "value": 45, "unit": "deg"}, {"axis": fingers, "value": "12.5"}])
    bend.validate(body)
    units = {float(str(value)): unit for node in body.objects(None, EX.goal)
             for value in body.objects(node, VOM.numericalValue) for unit in body.objects(node, VOM.unit)}  # fmt: skip
    assert units == {45.0: UNIT.DEG, 12.5: UNIT.MilliM}
    (root,) = body.subjects(RDF.type, EX.Bending)
    assert str(body.value(root, EX.mode)) == "soft"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "goal is missing"),
        ({"goal": {"axis": "Elbow", "value": 90, "unit": "deg"}}, "goal.value: 90 is not from -10 to less than 90"),
        ({"goal": {"axis": "Elbow", "value": 1, "unit": "mm"}}, "goal.unit: 'mm' is none of deg, rad"),
        ({"goal": {"axis": "Knee", "value": 1, "unit": "deg"}}, "goal.axis: 'Knee' is none of"),
        ({"goal": {"axis": "Elbow", "value": "x", "unit": "deg"}}, "goal.value: 'x' is not a valid number"),
        ({"goal": {"axis": "Elbow", "value": float("nan"), "unit": "deg"}}, "finite"),
        ({"goal": {"axis": "Elbow", "value": 1, "unit": "deg"}, "tries": 4}, "tries: 4 is not from 1 to less than 4"),
        ({"goal": {"axis": "Elbow", "value": 1, "unit": "deg"}, "tries": 1.5}, "tries: 1.5 is not a valid integer"),
        ({"goal": [{"axis": "Elbow", "value": 1, "unit": "deg"}] * 3}, "given 3 times; at most 2"),
        ({"goal": {"axis": "Elbow", "value": 1, "unit": "deg"}, "speed": 1}, "speed: there is no such field"),
        ({"goal": {"axis": "Elbow", "value": 1, "unit": "deg"}, "mode": "rude"}, "mode: 'rude' is none of soft, hard"),
    ],
)
def test_invalid_input_is_reported_and_not_sent(
    bend: Action, other_tree: Any, given: dict[str, Any], said: str
) -> None:
    with pytest.raises(InvalidInput, match=said):
        bend(**given)
    assert other_tree.sent("PUT") == []


def test_a_body_of_ones_own_is_judged_by_the_served_shape(bend: Action, elbow: Thing) -> None:
    """pySHACL finds what the form would not accept, and reports it with the message of the shape."""
    body = bend.build(goal={"axis": elbow, "value": 45, "unit": "deg"})
    bend.validate(body)
    (root,) = body.subjects(RDF.type, EX.Bending)
    body.set((root, EX.tries, rdflib.Literal(9)))
    with pytest.raises(InvalidInput, match="tries: 9 is not less than 4"):
        bend.validate(body)


def test_an_action_is_done_once_by_its_binding_and_followed(bend: Action, elbow: Thing, other_tree: Any) -> None:
    """By PUT, as its binding says; the job is polled, because this server has no events."""
    run = bend(goal={"axis": elbow, "value": 45, "unit": "deg"}, idempotency_key="k1")
    assert run.wait(30) == "succeeded"
    assert run.progress == 1.0
    ((path, sent),) = other_tree.sent("PUT")
    assert path == "/run/here"
    body = body_of(sent)
    assert {str(each) for each in body.objects(None, EX.axis)} == {str(elbow.iri)}
    at = [method for method, _, _ in other_tree.requests].index("PUT")
    assert other_tree.headers[at]["idempotency-key"] == "k1"


def test_an_action_without_shape_and_binding_is_done_as_options_allows(fleet: Fleet, other_tree: Any) -> None:
    run = fleet["cell"]["lefty"].actions["Rest"]()
    assert (run.has_location, run.wait(5), run.state) == (False, None, None)
    assert other_tree.sent("POST") == [("/do/rest", b"")]


def test_an_endless_invocation_is_reported_and_can_be_cancelled(bend: Action, elbow: Thing, other_tree: Any) -> None:
    """By the action that the invocation links."""
    other_tree.endless = True
    run = bend(goal={"axis": elbow, "value": 45, "unit": "deg"})
    with pytest.raises(StillRunning):
        run.wait(0.05)
    assert (run.state, run.progress) == ("running", 0.5)
    run.cancel()
    assert run.wait(30) == "cancelled"


def test_an_invocation_without_actions_is_cancelled_by_delete(fleet: Fleet, other_tree: Any) -> None:
    """One that has ended is not, and one without a location cannot be."""
    running, ended = (fleet.get(f"{other_tree.url}/runs/{number}") for number in (1, 2))
    assert isinstance(running, Invocation) and isinstance(ended, Invocation)
    running.cancel()
    assert other_tree.sent("DELETE") == [("/runs/1", b"")]
    assert (str(ended.ended_at), running.ended_at) == ("2026-11-21 10:00:05+00:00", None)
    with pytest.raises(Unsupported, match="has ended already: it is succeeded"):
        ended.cancel()
    with pytest.raises(Unsupported, match="no Location"):
        fleet["cell"]["lefty"].actions["Rest"]().cancel()
    assert len(other_tree.sent("DELETE")) == 1


def test_a_rehearsal_is_not_sent_to_a_server_that_might_execute_it(bend: Action, elbow: Thing, other_tree: Any) -> None:
    with pytest.raises(Unsupported, match="dryRun"):
        bend.rehearse(goal={"axis": elbow, "value": 45, "unit": "deg"})
    assert other_tree.sent("PUT") == []


def test_a_refusal_is_an_exception_with_its_problem_details(fleet: Fleet) -> None:
    with pytest.raises(Problem) as refused:
        fleet["cell"]["lefty"].actions["Break"]()
    problem = refused.value
    assert (problem.status, problem.title, problem.detail, problem.messages) == (409, "No", "it is broken", ("a: m",))


def test_unchanged_resources_are_read_conditionally(elbow: Thing, other_tree: Any) -> None:
    """Every reading is conditional, with the last ETag."""
    angle = elbow.properties["angle"]
    assert angle.value == angle.value
    asked = [headers for (_, path, _), headers in zip(other_tree.requests, other_tree.headers, strict=True)
             if path == "/v/aa1"]  # fmt: skip
    assert ["if-none-match" in headers for headers in asked] == [False, True]


def test_resources_without_event_streams_are_polled(elbow: Thing) -> None:
    changes = list(elbow.properties["angle"].subscribe(timeout_s=0.2))
    assert [change.reading.main.number for change in changes if change.reading.main] == [12.5]
    assert changes[0].resource == URIRef(elbow.properties["angle"].iri)


def test_a_server_without_missions_is_told(fleet: Fleet) -> None:
    with pytest.raises(Unsupported, match="links no missions"):
        _ = fleet.missions
