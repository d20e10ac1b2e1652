"""What a fleet links beside its robots, found by name, with members to add and remove."""

from collections.abc import Iterator
from typing import Any

import pytest
from rdflib import RDF, BNode, Graph, Literal, Namespace, URIRef

from linked_fleet_client.errors import NoSuchThing, Problem, Unsupported
from linked_fleet_client.fleet import Collection, Fleet
from linked_fleet_client.vocabulary import DCTERMS, LF, VOM
from shared_fixtures import RunningFleet

pytestmark = pytest.mark.virtual
ROBOTS = ("ur5",)
METRE = "http://qudt.org/vocab/unit/M"
MATHS = Namespace("http://vocab.arvida.de/2015/06/maths/vocab#")
BALL = {
    "title": "ball",
    "position": {"x": 9, "y": 9, "z": 9, "unit": METRE},
    "geometry": {"form": str(LF.Sphere), "radius": {"value": 0.1, "unit": METRE}},
}


@pytest.fixture
def here(fleet: RunningFleet) -> Iterator[Fleet]:
    with Fleet(fleet.root) as here:
        yield here


def crate() -> Graph:
    graph, crate, place, form, radius = Graph(), URIRef(""), BNode(), BNode(), BNode()
    graph.add((crate, RDF.type, LF.Obstacle))
    graph.add((crate, DCTERMS.title, Literal("crate")))
    graph.add((crate, LF.position, place))
    for axis in "xyz":
        graph.add((place, MATHS[axis], Literal(8)))
    graph.add((crate, LF.geometry, form))
    graph.add((form, RDF.type, LF.Sphere))
    graph.add((form, LF.radius, radius))
    graph.add((radius, VOM.numericalValue, Literal(0.2)))
    for node in (place, radius):
        graph.add((node, VOM.unit, URIRef(METRE)))
    return graph


@pytest.mark.parametrize(
    ("path", "address"),
    [
        ("world", "world"),
        ("rules", "rules"),
        ("histories", "history"),
        ("history", "history"),
        ("things", "things"),
        ("subscriptions", "subscriptions"),
        ("world/objects", "world/objects"),
        ("world/collisions", "world/collisions"),
        ("ur5/lease", "ur5/lease"),
        ("ur5/history", "ur5/history"),
        ("ur5/elbow_joint/subscriptions", "ur5/elbow_joint/subscriptions"),
    ],
)
def test_what_a_thing_links_is_found_by_the_name_of_the_link_or_its_address(
    here: Fleet, path: str, address: str
) -> None:
    found = here.at(path)
    assert (str(found.iri), type(found)) == (str(here.iri) + address, Collection)
    one, *rest = path.split("/")
    thing = here[one]
    for name in rest:
        thing = thing[name]
    assert thing.iri == found.iri


def test_parts_come_first_and_names_that_do_not_exist_are_told(here: Fleet) -> None:
    assert type(here["world"]["ur5"]).__name__ == "Thing"
    assert ("rules" in here, "ur5" in here, here["ur5"] in here, "nobody" in here) == (True, True, True, False)
    with pytest.raises(NoSuchThing, match=r"no part is called 'word'; there is .*world") as error:
        here["word"]
    assert {"ur5", "rules", "world"} <= set(error.value.known)
    assert {each.name for each in here.collections} >= {"world", "rules", "histories", "things", "subscriptions"}
    assert not {each.iri for each in here["ur5"].collections} & {each.iri for each in here["ur5"].parts}


@pytest.mark.parametrize(("member", "name"), [(BALL, "ball"), (crate(), "crate")], ids=["json", "graph"])
def test_members_are_listed_added_and_removed(here: Fleet, member: Any, name: str) -> None:
    objects = here["world"]["objects"]
    assert isinstance(objects, Collection)
    assert name not in objects
    added = objects.add(member)
    assert (added.title, [each.iri for each in objects]) == (name, [added.iri])
    assert objects[name].iri == added.iri
    assert name in objects
    objects.remove(name)
    assert list(objects) == []
    objects.remove(objects.add(member))
    assert list(objects) == []
    with pytest.raises(NoSuchThing, match=name):
        objects.remove(name)


def test_a_member_that_breaks_the_shape_is_refused_with_its_reasons(here: Fleet) -> None:
    objects = here["world"]["objects"]
    assert isinstance(objects, Collection)
    with pytest.raises(Problem) as refused:
        objects.add({**BALL, "title": ""})
    assert refused.value.status == 422


@pytest.mark.parametrize("path", ["world", "history", "things"])
def test_what_takes_no_members_says_so(here: Fleet, path: str) -> None:
    found = here[path]
    assert isinstance(found, Collection)
    with pytest.raises(Unsupported, match="does not take POST"):
        found.add({"title": "x"})
    with pytest.raises(Unsupported, match="does not take DELETE"):
        found.remove(here["ur5"]["elbow_joint"])
    with pytest.raises(Problem, match="Stop its agent first"):
        found.remove(here["ur5"])


def test_finding_a_robot_asks_no_more_than_before(here: Fleet) -> None:
    """What the fleet links is looked at only when no part has the name."""
    asked: list[object] = []
    here.web.http.event_hooks = {"request": [asked.append]}
    assert here["ur5"].name == "ur5"
    assert len(asked) == 1
