"""The placement of a robot in the world: its body, its record, its description. Pure; metre.

A robot that nobody has placed has no known place: nothing is taken for granted. Of a robot with a floating base it is
the frame of its odometry that is placed, in which its agent says where the base is.
"""

import math

import msgspec
from pyoxigraph import NamedNode

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.fleet.kinematics import compose
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.fleet.xml import Quaternion, Vector
from linked_fleet_gateway.rdf.graph import Graph, Node
from linked_fleet_gateway.rdf.units import METRE
from linked_fleet_gateway.rdf.vocabulary import LF, MATHS
from linked_fleet_gateway.resources.action_body import Body

PLACEMENT = "placement"
WORLD = "/world"
_UNIT_LENGTH = 1e-3  # how far a quaternion may be from length one
_UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)


def read_placement(body: Body) -> str:
    return msgspec.json.encode(read_pose(body)).decode()


def placement_of(robot: Robot) -> Pose | None:
    """None for a robot that nobody has placed, as far as is known."""
    said = robot.settings.get(PLACEMENT)
    return None if said is None else msgspec.json.decode(said, type=Pose)


def pose_in_world(robot: Robot, link: str) -> Pose | None:
    """None while either is unknown: where the robot stands, or where the link is in it."""
    placement, pose = placement_of(robot), robot.link_pose(link)
    return None if placement is None or pose is None else compose(placement, pose)


def read_pose(body: Body) -> Pose:
    """Return the placement of an admitted body; without ``lf:orientation`` upright. UnprocessableContent."""
    position, orientation = body.node(body.root, LF.position), body.node(body.root, LF.orientation)
    assert position is not None
    return Pose(read_vector(body, position), _UPRIGHT if orientation is None else _quaternion(body, orientation))


def read_vector(body: Body, node: Node) -> Vector:
    scale = body.unit(node)
    x, y, z = (_number(body, node, axis) * scale for axis in (MATHS.x, MATHS.y, MATHS.z))
    return x, y, z


def describe_pose(graph: Graph, iri: Node, pose: Pose | None) -> None:
    graph.vector(iri, LF.position, None if pose is None else pose.position_m, METRE)
    graph.quaternion(iri, LF.orientation, None if pose is None else pose.orientation_xyzw)


def _quaternion(body: Body, node: Node) -> Quaternion:
    x, y, z, w = (_number(body, node, axis) for axis in (MATHS.x, MATHS.y, MATHS.z, LF.w))
    length = math.hypot(x, y, z, w)
    if abs(length - 1.0) > _UNIT_LENGTH:
        raise UnprocessableContent(f"The quaternion has length {length:.6g}; an orientation has length 1.")
    return x / length, y / length, z / length, w / length


def _number(body: Body, node: Node, axis: NamedNode) -> float:
    value = body.number(node, axis)
    assert value is not None
    return value
