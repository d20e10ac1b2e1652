"""A robot moves when its frames show it, whoever causes it."""

import math

import pytest

from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.invocations import Invocations
from mirrored_fleet import MirroredFleet

SECOND_NS = 1_000_000_000
QUARTER_NS = SECOND_NS // 4
T0_NS = 1_750_000_000 * SECOND_NS


def told(mirrored: MirroredFleet) -> list[str]:
    """Return which of moving and lastMoved the fleet states of the robot."""
    resource, graph = Tree(mirrored.fleet, Invocations(), "http://example.org").resolve("/"), Graph()
    assert isinstance(resource, Resource)
    assert resource.describe is not None
    resource.describe(graph)
    names = {LF.moving: "moving", LF.lastMoved: "lastMoved"}
    return sorted(names[triple.predicate] for triple in graph.triples if triple.predicate in names)


@pytest.mark.parametrize(
    ("positions", "moves"),
    [
        pytest.param([0.5, 0.5, 0.5, 0.5], False, id="rest"),
        pytest.param([0.5, 0.5005, 0.4995, 0.5], False, id="noise"),
        pytest.param([0.5, 0.6, 0.5, 0.4], True, id="sway"),
        pytest.param([0.5, 0.501, 0.502, 0.503], True, id="slow"),
        pytest.param([0.5, math.nan, 0.5, math.nan], False, id="unknown at times"),
        pytest.param([math.nan, math.nan, 0.5, 0.5], False, id="becomes known"),
    ],
)
def test_a_robot_moves_while_its_positions_change(positions: list[float], moves: bool) -> None:
    """No command is given."""
    mirrored = MirroredFleet()
    mirrored.describe("r")
    now_ns = T0_NS
    for position in positions:
        mirrored.stand("r", (position, 0.0))
        mirrored.fleet.check_movement("r", now_ns)
        now_ns += QUARTER_NS
    assert mirrored.fleet.robots["r"].moving is moves
    assert told(mirrored) == (["moving"] if moves else [])
    change = mirrored.fleet.check_movement("r", now_ns + 2 * SECOND_NS)
    assert (change is not None) is moves
    assert told(mirrored) == (["lastMoved"] if moves else [])


def test_another_run_elsewhere_is_no_movement() -> None:
    mirrored = MirroredFleet()
    mirrored.describe("r")
    mirrored.stand("r", (0.5, 0.0))
    mirrored.fleet.check_movement("r", T0_NS)
    mirrored.fleet.robots["r"].start_run(7_000_000)
    assert mirrored.fleet.check_movement("r", T0_NS + QUARTER_NS) is None
    assert not mirrored.fleet.robots["r"].moving
