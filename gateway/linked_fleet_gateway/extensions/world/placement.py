"""The placement of a robot in the world: its body, its record, its description, its property. Metre.

Without a placement the position of a robot is unknown; there is no default. For a floating base the placement is that
of the odometry frame, in which its agent reports the base. The terms of the extension are here too.
"""

import logging
import math
from functools import lru_cache

import msgspec
from msgspec import Struct
from pyoxigraph import Literal, NamedNode

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.api import Body, Property, robot_path
from linked_fleet_gateway.faces import Measurement, Setting
from linked_fleet_rdf.graph import METRE, Graph, Node
from linked_fleet_rdf.vocabulary import HYBRIT, MATHS
from linked_fleet_rdf.vocabulary import LF as CORE
from linked_fleet_state.kinematics import compose
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot
from linked_fleet_state.xml import Quaternion, Vector

LF = CORE.extended(
    "World Placement SceneObject SceneObjects Obstacle KeepOutZone Box Sphere Cylinder TriangleMesh"
    " WorldShape PlacementShape PlacementInput SceneObjectShape SceneObjectsShape SceneObjectInput"
    " PoseInFrameShape PoseInFrame world placement inFrame poseOf objects poses geometry size radius"
    " length stl Collisions Collision CollisionsShape collisions collision meets collisionFree acceptsUnchecked"
    " model mesh heading Relocalise OccupancyMap OccupancyMapShape map resolution columns rows occupiedCells freeCells"
    " unknownCells obstacleBoxes occupiedThreshold freeThreshold mapMode mapImage mapSettings mapPicture sha256"
    " heldBy mayTouch object Gripper UnreadableObject"
)

log = logging.getLogger(__name__)

PLACEMENT = "placement"
WORLD = "/world"
_UNIT_LENGTH = 1e-3  # tolerance of a quaternion's length
_UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)


class _Record(Struct, frozen=True, omit_defaults=True):
    """A stored placement: the members of a pose, and whether the check may ignore links that it does not cover."""

    position_m: Vector
    orientation_xyzw: Quaternion
    accepts_unchecked: bool = False


def read_placement(body: Body) -> str:
    return encode_placement(read_pose(body), body.text(body.root, LF.acceptsUnchecked) in ("true", "1"))


def encode_placement(pose: Pose, accepts_unchecked: bool) -> str:
    """Return the record of a placement, as the settings of a robot have it."""
    return msgspec.json.encode(_Record(pose.position_m, pose.orientation_xyzw, accepts_unchecked)).decode()


def has_placement(robot: Robot) -> bool:
    """Return True if the robot has a placement, which may be unreadable."""
    return PLACEMENT in robot.settings


def placement_of(robot: Robot) -> Pose | None:
    """Return the placement of a robot; None if it has none, or one that cannot be read."""
    held = _record_of(robot)
    return None if held is None else Pose(held.position_m, held.orientation_xyzw)


def accepts_unchecked(robot: Robot) -> bool:
    """Return True if the placement accepts that the check does not cover some links of the robot."""
    held = _record_of(robot)
    return held is not None and held.accepts_unchecked


def _record_of(robot: Robot) -> _Record | None:
    record = robot.settings.get(PLACEMENT)
    return None if record is None else _decoded(robot.name, record)


@lru_cache(maxsize=4096)
def _decoded(robot: str, record: str) -> _Record | None:
    try:
        return msgspec.json.decode(record, type=_Record)
    except ValueError:
        log.error("the placement of %s cannot be read: %.200r", robot, record)  # once, because the result is kept
        return None


def pose_in_world(robot: Robot, link: str) -> Pose | None:
    """Return the pose of a link in the world; None if the placement or the pose in the robot is unknown."""
    placement, pose = placement_of(robot), robot.link_pose(link)
    return None if placement is None or pose is None else compose(placement, pose)


def read_pose(body: Body) -> Pose:
    """Return the placement in a validated body; upright without ``lf:orientation``. Raises UnprocessableContent."""
    position, orientation = body.node(body.root, LF.position), body.node(body.root, LF.orientation)
    assert position is not None
    return Pose(read_vector(body, position), _UPRIGHT if orientation is None else _quaternion(body, orientation))


def read_vector(body: Body, node: Node) -> Vector:
    scale = body.unit(node)
    x, y, z = (number_of(body, node, axis) * scale for axis in (MATHS.x, MATHS.y, MATHS.z))
    return x, y, z


def describe_pose(graph: Graph, iri: Node, pose: Pose | None) -> None:
    graph.vector(iri, LF.position, None if pose is None else pose.position_m, METRE)
    graph.quaternion(iri, LF.orientation, None if pose is None else pose.orientation_xyzw)


def _quaternion(body: Body, node: Node) -> Quaternion:
    x, y, z, w = (number_of(body, node, axis) for axis in (MATHS.x, MATHS.y, MATHS.z, LF.w))
    length = math.hypot(x, y, z, w)
    if abs(length - 1.0) > _UNIT_LENGTH:
        raise UnprocessableContent(f"The quaternion has length {length:.6g}; an orientation has length 1.")
    return x / length, y / length, z / length, w / length


def number_of(body: Body, node: Node, axis: NamedNode) -> float:
    """Return a number that the shape of the body requires."""
    value = body.number(node, axis)
    assert value is not None
    return value


def describe_placement(graph: Graph, iri: Node, robot: Robot) -> None:
    """Describe where the robot stands and, if it does, that its unchecked links are accepted."""
    describe_pose(graph, iri, placement_of(robot))
    if accepts_unchecked(robot):
        graph.add(iri, LF.acceptsUnchecked, Literal(True))


def placement(robot: Robot) -> Property:
    def describe(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        describe_placement(graph, iri, robot)
        root = iri.value.removesuffix(robot_path(robot.name) + PLACEMENT)
        graph.add(iri, LF.inFrame, NamedNode(root + WORLD))
        graph.add(iri, HYBRIT.consumes, LF.PlacementInput)

    setting = Setting(robot, PLACEMENT, LF.PlacementInput, read_placement, removable=True, decides_checks=True)
    title = f"placement of {robot.name}"
    return Property(PLACEMENT, LF.placement, (LF.Placement,), LF.PlacementShape, title, describe, put=setting)
