"""Motions that were refused are listed with what would have met, as far as who asks may know it."""

from types import MappingProxyType
from typing import Any

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.extensions.world.collisions import COLLISIONS, Collides, Collisions, resolve_collisions
from linked_fleet_gateway.extensions.world.page import collisions
from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_identity.rights import ALL
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.invocations import Invocations

_JOINTS = {"j": ("revolute", "")}
_REFUSED = Collides(
    "j_link of r would meet base of other after 20 % of the way.",
    things=["/r/j_link", "/other/base"],
    names=["j_link of r", "base of other"],
    share=0.2,
    point=(1.0, 2.0, 0.5),
    reason="j_link would meet another robot after 20 % of the way",
)


def view(bench: Any, *hidden: str) -> RequestView:
    robots = {name: robot for name, robot in bench.fleet.robots.items() if name not in hidden}
    return RequestView(bench.base, MappingProxyType(robots), InvocationsInView(Invocations(), ALL), ALL)


def page(known: Collisions, seen: RequestView) -> Any:
    resource, graph = resolve_collisions(seen, [], known.known), Graph()
    assert resource is not None and resource.describe is not None
    resource.describe(graph)
    iri = NamedNode(seen.base + COLLISIONS)
    return graph.triples, collisions(Facts(graph.triples, seen.base + "/"), iri).more["refused"]


def refused(bench: Any) -> tuple[Collisions, list[str]]:
    bench.robot(_JOINTS), bench.robot(_JOINTS, name="other")
    touched: list[str] = []
    found = Collisions(touched.append)
    found.add("r", _REFUSED)
    return found, touched


def test_a_refused_motion_is_listed_with_both_things_and_the_place(bench: Any) -> None:
    known, touched = refused(bench)
    triples, (one,) = page(known, view(bench))
    assert one.reason == _REFUSED.detail
    assert [(each.text, each.href) for each in one.things] == [
        ("j_link of r", "http://example.org/r/j_link"),
        ("base of other", "http://example.org/other/base"),
    ]
    assert [each for each in triples if each.predicate == LF.position] and touched == [COLLISIONS]


def test_a_collision_does_not_name_an_invisible_robot(bench: Any) -> None:
    known, _ = refused(bench)
    triples, (one,) = page(known, view(bench, "other"))
    assert (one.reason, one.things) == (_REFUSED.reason, [])
    text = " ".join(each.object.value for each in triples if isinstance(each.object, Literal | NamedNode))
    assert "other" not in text.replace("another", "") and not [
        each for each in triples if each.predicate == LF.position
    ]


def test_collisions_of_invisible_robots_are_hidden(bench: Any) -> None:
    known, _ = refused(bench)
    assert page(known, view(bench, "r"))[1] == []


def test_a_collision_is_removed_by_a_free_motion(bench: Any) -> None:
    """Subscribers hear of it; of a motion that was free before there is no news."""
    known, touched = refused(bench)
    known.forget("r")
    known.forget("r")
    assert page(known, view(bench))[1] == [] and touched == [COLLISIONS, COLLISIONS]
