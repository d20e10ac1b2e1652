"""Messages between the gateway and the check process. Metre, radian; MessagePack."""

from typing import Literal

from msgspec import Struct

from linked_fleet_agent import planar
from linked_fleet_agent.planar import Velocity
from linked_fleet_gateway.extensions.world.scene import Geometry
from linked_fleet_state.driving import Drive
from linked_fleet_state.model import Pose
from linked_fleet_state.unchecked import UncheckedLink
from linked_fleet_state.xml import Vector

Positions = dict[str, float]
Kind = Literal["self", "robot", "object", "map"]


class Prepare(Struct, frozen=True, tag="prepare"):
    """Build the shapes of a robot, stored under ``key``. ``meshes`` maps URIs in the URDF to file names.

    A file name is the digest of a mesh with the suffix of its format. ``unusable`` are the reasons, by file name, why
    meshes cannot be used. With ``unusable_robot`` no shape is built, for this reason. The base of a robot that
    ``drives`` is carried by joints (``plane.py``). The answer may be MeshesMissing.
    """

    key: str
    urdf: str
    meshes: dict[str, str]
    unusable: dict[str, str] = {}
    unusable_robot: str = ""
    drives: bool = False


class PrepareMesh(Struct, frozen=True, tag="mesh"):
    """The content of a mesh, for robots prepared later."""

    name: str
    content: bytes


class PrepareObject(Struct, frozen=True, tag="object"):
    """Build the shape of an object, stored under ``key``."""

    key: str
    geometry: Geometry


class PrepareMap(Struct, frozen=True, tag="map"):
    """Build the obstacles of the map of the floor, stored under ``key`` in place of those of another map.

    ``boxes`` are rectangles of cells: column, row, columns, rows as little-endian 16-bit numbers. ``origin`` is the
    corner of cell [0, 0] in the world: x, y, yaw. Obstacles are ``height_m`` high, from z = 0.
    """

    key: str
    boxes: bytes
    resolution_m: float
    origin: tuple[float, float, float]
    height_m: float


class HeldObject(Struct, frozen=True):
    """A prepared object that a robot holds: its ``name`` in answers, and its ``pose`` in the frame of the ``link``.

    It may touch the links of the ``hand``.
    """

    name: str
    key: str
    link: str
    pose: Pose
    hand: tuple[str, ...]


class Placement(Struct, frozen=True):
    """The placement of a prepared robot or object: its ``name`` in answers, and ``base``, its root pose in the world.

    ``configurations`` are all joint positions in which it may be met: the first is complete, others contain only what
    differs. ``way`` are the poses on its way from where its base is now, in the frame of that. With
    ``accepts_unchecked`` the links that the check does not cover are ignored. A robot ``holds`` objects. ``times_s``
    says from when until when it may be met in each configuration, in seconds from now; empty means at any time.
    """

    name: str
    key: str
    base: Pose
    configurations: tuple[Positions, ...] = ()
    accepts_unchecked: bool = False
    way: tuple[planar.Pose, ...] = ()
    holds: tuple[HeldObject, ...] = ()
    times_s: tuple[tuple[float, float], ...] = ()


class PathSegment(Struct, frozen=True):
    """A segment in which joints move together to ``ends``: linearly, or as cubics with these velocities at both ends.

    ``duration_s`` is the time of a segment with velocities. ``timing`` are times from the start of a linear one and the
    shares of it completed by then, from the start to the end, if they are known.
    """

    ends: Positions
    duration_s: float = 0.0
    start_velocities: Positions = {}
    end_velocities: Positions = {}
    timing: tuple[tuple[float, float], ...] = ()


class MotionPath(Struct, frozen=True):
    start: Positions
    legs: tuple[PathSegment, ...]


class DrivenWay(Struct, frozen=True):
    """The ways of a base that moves like ``now`` and may move like ``before`` (``Drive.ways``).

    ``start`` are the positions of the joints of the robot, ``elsewhere`` the targets of those in other motions.
    """

    drive: Drive
    now: Velocity
    before: Velocity | None
    start: Positions
    elsewhere: Positions


class Check(Struct, frozen=True, tag="check"):
    """Request to check if the robot collides on any of the ``paths``, or where it is ``driven``.

    It is now at the start of the first path.

    The answer takes at most ``within_s`` seconds of processor time. ``map`` is the key of the map of the floor, empty
    without one. The links of the ``hand``, and what the robot holds, may touch the objects ``may_touch``. ``in_time``
    says that it begins now and keeps the times of its paths, so that other robots are met only at theirs. For
    ``closest_within_s`` seconds more it is sought where the robot comes closest to what is around.
    """

    robot: Placement
    paths: tuple[MotionPath, ...]
    robots: tuple[Placement, ...]
    objects: tuple[Placement, ...]
    within_s: float
    map: str = ""
    driven: DrivenWay | None = None
    closest_within_s: float = 0.0
    may_touch: tuple[str, ...] = ()
    hand: tuple[str, ...] = ()
    in_time: bool = False


class Survey(Struct, frozen=True, tag="survey"):
    """Request of what the robot of a check could meet on the floor, with ``start``, the positions of its joints."""

    around: Check
    start: Positions


Plan = tuple[tuple[float, float], ...]
"""Corners of a convex polygon on the floor, counterclockwise."""


class Seen(Struct, frozen=True):
    """An object or a robot, seen from above in the world: what it covers, and what it will cover on its way."""

    kind: Kind
    name: str
    covers: tuple[Plan, ...]
    way: tuple[Plan, ...] = ()


class Surveyed(Struct, frozen=True, tag="surveyed"):
    """The outline of the robot in the frame of its root, and what is around it."""

    outline: Plan
    things: tuple[Seen, ...]


class Ready(Struct, frozen=True, tag="ready"):
    """It is prepared; no check covers the ``unchecked`` links of the robot.

    ``reach_m`` is a bound of the distance of a robot from its root.
    """

    unchecked: tuple[UncheckedLink, ...] = ()
    reach_m: float = 0.0


class MeshesMissing(Struct, frozen=True, tag="lacks"):
    """File names of the meshes that are missing for preparing a robot."""

    meshes: tuple[str, ...]


class CollisionFound(Struct, frozen=True, tag="meets"):
    """A collision: ``link`` meets something after ``share`` of the path.

    That is link ``other`` of robot ``name``, object ``name``, or the map, whose name is empty.
    ``point`` is the place in the world, None if unknown. If it is an object that meets something or is met, the link
    is the one that holds it, and ``held`` or ``other_held`` is the object.
    """

    link: str
    kind: Kind
    name: str
    other: str
    share: float
    point: Vector | None = None
    held: str = ""
    other_held: str = ""


class ClosestFound(Struct, frozen=True):
    """The place where the robot comes closest to what ``met`` names, on the first path of a check.

    Elsewhere it may come nearer than ``apart_m`` by ``uncertain_m``. ``at_s`` is the time on a trajectory.
    """

    met: CollisionFound
    apart_m: float
    uncertain_m: float
    at_s: float | None


class Free(Struct, frozen=True, tag="free"):
    """The path is free; ``samples`` is the number of places that were checked.

    ``unchecked`` are the names of the other robots nearby that have unchecked links, which their placements accept.
    ``covered`` is False if no link of the robot was checked.
    """

    samples: int
    unchecked: tuple[str, ...] = ()
    covered: bool = True
    closest: ClosestFound | None = None


class UncheckedNear(Struct, frozen=True, tag="near"):
    """Links that the check does not cover may meet something. The links are those of the moving robot, if ``own``.

    ``name`` is the object or the other robot; empty for the map.
    """

    own: bool
    kind: Kind
    name: str


class CheckFailed(Struct, frozen=True, tag="unable"):
    reason: str


Question = Prepare | PrepareMesh | PrepareObject | PrepareMap | Check | Survey
Answer = Ready | MeshesMissing | Free | CollisionFound | UncheckedNear | CheckFailed | Surveyed
