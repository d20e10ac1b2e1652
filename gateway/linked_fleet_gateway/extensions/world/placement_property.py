"""The placement of a robot as a property: the pose of its root in the world, which clients may set."""

from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.world.placement import (
    PLACEMENT,
    WORLD,
    describe_pose,
    placement_of,
    read_placement,
)
from linked_fleet_gateway.extensions.world.terms import LF
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.vocabulary import HYBRIT
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.property import Property, Seen
from linked_fleet_gateway.resources.setting import Setting


def placement(robot: Robot) -> Property:
    def describe(graph: Graph, iri: NamedNode, _: Seen) -> None:
        describe_pose(graph, iri, placement_of(robot))
        root = iri.value.removesuffix(robot_path(robot.name) + PLACEMENT)
        graph.add(iri, LF.inFrame, NamedNode(root + WORLD))
        graph.add(iri, HYBRIT.consumes, LF.PlacementInput)

    setting = Setting(robot, PLACEMENT, LF.PlacementInput, read_placement, removable=True)
    title = f"placement of {robot.name}"
    return Property(PLACEMENT, LF.placement, (LF.Placement,), LF.PlacementShape, title, describe, put=setting)
