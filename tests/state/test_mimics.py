"""Joints that mimic others and are not measured themselves: their positions are derived, and say so."""

import json
import math
from collections.abc import Sequence

import pytest
from pyoxigraph import NamedNode

from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, State
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations

BASE = "http://example.org"
URDF = """<robot name="hand"><link name="palm"/><link name="a"/><link name="b"/><link name="c"/>
<joint name="t" type="prismatic"><parent link="palm"/><child link="a"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="r" multiplier="0.5" offset="0.002"/></joint>
<joint name="r" type="prismatic"><parent link="palm"/><child link="b"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" velocity="1" effort="1"/><mimic joint="l" multiplier="-1" offset="0.01"/></joint>
<joint name="l" type="prismatic"><parent link="palm"/><child link="c"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
JOINTS = ("t", "r", "l")
NAN = math.nan


class Hand:
    def __init__(self) -> None:
        self.fleet, self._sequence = Fleet(), 0
        said = Description(
            version=1, robot="h", incarnation=1, title="h", urdf=URDF, joints=JOINTS, rate_hz=100,
            layout=layout(3, False),
        )  # fmt: skip
        self.fleet.apply(Appeared("h", 1), 1)
        self.fleet.apply(Described(said), 1)

    def stand(self, *positions: float) -> None:
        self._sequence += 1
        frame = State(
            incarnation=1, sequence=self._sequence, monotonic_ns=1, wall_ns=self._sequence, positions=positions,
            velocities=(NAN,) * 3, efforts=(NAN,) * 3,
        )  # fmt: skip
        self.fleet.apply(Framed("h", encode_state(frame)), 1)

    def sources(self, path: str) -> list[str]:
        """Return the joints from which a document derives positions."""
        graph = Graph()
        resource = self.resource(path)
        assert resource.describe is not None
        resource.describe(graph)
        found = [each.object for each in graph.triples if each.predicate == LF.derivedFrom]
        return [each.value.removeprefix(BASE) for each in found if isinstance(each, NamedNode)]

    def resource(self, path: str) -> Resource:
        found = Tree(self.fleet, Invocations(), BASE).resolve(path)
        assert isinstance(found, Resource)
        return found


@pytest.mark.parametrize(
    ("measured", "known", "derived"),
    [
        ((NAN, NAN, 0.1), (-0.043, -0.09, 0.1), ["/h/r", "/h/l"]),
        ((NAN, 0.2, 0.1), (0.102, 0.2, 0.1), ["/h/r"]),
        ((0.3, 0.2, 0.1), (0.3, 0.2, 0.1), []),
        ((0.3, NAN, NAN), (0.3, NAN, NAN), []),
        ((NAN, NAN, NAN), (NAN, NAN, NAN), []),
    ],
)
def test_positions_that_are_not_measured_are_derived_where_they_can_be(
    measured: Sequence[float], known: Sequence[float], derived: list[str]
) -> None:
    hand = Hand()
    hand.stand(*measured)
    assert list(hand.fleet.robots["h"].positions.values()) == pytest.approx(known, nan_ok=True)
    assert hand.sources("/h/jointState") == derived
    assert hand.sources("/h/r/translation") == (["/h/l"] if "/h/l" in derived else [])


def test_the_mark_goes_when_the_joint_is_measured() -> None:
    """Also if its value stays the same."""
    hand = Hand()
    hand.stand(0.0, NAN, 0.1)
    assert hand.sources("/h/r/translation") == ["/h/l"]
    told = json.loads(hand.resource("/h/r/translation").documents["application/json"]())
    assert (told["derivedFrom"], told["value"]) == (f"{BASE}/h/l", -0.09)
    hand.stand(0.0, -0.09, 0.1)
    assert hand.sources("/h/r/translation") == []
    hand.stand(0.0, NAN, 0.1)
    assert hand.sources("/h/r/translation") == ["/h/l"]


def test_links_behind_a_derived_joint_have_a_pose() -> None:
    hand = Hand()
    hand.stand(NAN, NAN, 0.1)
    pose = hand.fleet.robots["h"].link_pose("a")
    assert pose is not None and pose.position_m == pytest.approx((-0.043, 0.0, 0.0))
