"""The messages between agents and gateways (PROTOCOL.md). SI units; angles in radian, lengths in metre."""

from typing import Annotated, Literal

from msgspec import UNSET, Meta, Raw, Struct, UnsetType

WIRE_VERSION = 1
"""The version of messages about joints, and of descriptions. Gateways of version 1 understand them."""
COMPONENTS_VERSION = 2
"""The version of messages about components, which it added; it left the others as they are."""

Name = Annotated[str, Meta(min_length=1, max_length=128)]
Identifier = Annotated[str, Meta(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9-]+\Z")]
Unsigned = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Text = Annotated[str, Meta(max_length=65_536)]
MediaType = Annotated[str, Meta(max_length=64, pattern=r"^[a-z0-9.+-]+/[a-z0-9.+-]+\Z")]
MAX_MESHES, MAX_MESH_URI, MAX_MESH_BYTES = 1024, 512, 64 * 2**20
MAX_CAMERAS, MAX_PIXELS = 16, 2**20
MAX_TOLERANCE = 1.0
Tolerance = Annotated[float, Meta(gt=0, le=MAX_TOLERANCE)]
PictureFormat = Literal["jpeg", "png", "depth"]


class Field(Struct, frozen=True, forbid_unknown_fields=True):
    """A run of values in the binary frame: ``count`` values of ``type`` from byte ``offset``."""

    name: Name
    type: Literal["char2", "uint16", "uint64", "int64", "float64"]
    offset: Unsigned
    count: Unsigned


class Mesh(Struct, frozen=True, kw_only=True):
    """A mesh that the agent serves: ``uri`` as an XML parser reads it in the URDF, ``size`` in bytes."""

    uri: Annotated[str, Meta(min_length=1, max_length=MAX_MESH_URI)]
    sha256: Annotated[str, Meta(pattern=r"^[0-9a-f]{64}\Z")]
    size: Annotated[int, Meta(gt=0, le=MAX_MESH_BYTES)]
    type: MediaType


class Camera(Struct, frozen=True, kw_only=True):
    """An ideal pinhole camera of the robot: no distortion, principal point in the centre, square pixels.

    The pose is that of its optical frame (z ahead, x right and y down in the picture, as in ROS REP 103) in the frame
    of ``link``. ``formats`` are the available kinds of picture, as in PictureFormat; gateways ignore others.
    ``unavailable`` is the reason why there are none, or empty.
    """

    name: Name
    link: Name
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    width: Annotated[int, Meta(ge=1, le=4096)]
    height: Annotated[int, Meta(ge=1, le=4096)]
    vertical_fov_rad: Annotated[float, Meta(gt=0, le=3.1)]
    near_m: Annotated[float, Meta(gt=0, le=1e6)]
    far_m: Annotated[float, Meta(gt=0, le=1e6)]
    formats: Annotated[tuple[Annotated[str, Meta(max_length=32)], ...], Meta(max_length=16)] = ()
    unavailable: Annotated[str, Meta(max_length=512)] = ""


class Description(Struct, frozen=True, kw_only=True):
    """The description of a robot by its agent; ``joints`` is the order of the arrays in its state frames.

    ``passive`` are those of them that take no commands. ``tolerances`` says by joint how near to its target a motion
    brings it (rad or m), where that is known. Components are read apart from the rest (``wire/components.py``).
    """

    version: int
    robot: Name
    incarnation: Unsigned
    title: Annotated[str, Meta(max_length=256)]
    urdf: Annotated[str, Meta(max_length=8_000_000)]
    base: Literal["fixed", "floating"] = "fixed"
    joints: Annotated[tuple[Name, ...], Meta(max_length=1024)]
    passive: Annotated[tuple[Name, ...], Meta(max_length=1024)] = ()
    tolerances: Annotated[dict[Name, Tolerance], Meta(max_length=1024)] = {}
    rate_hz: Annotated[float, Meta(gt=0, le=10_000)]
    capabilities: Annotated[tuple[Annotated[str, Meta(max_length=32)], ...], Meta(max_length=64)] = ()
    annotations: Text = ""
    meshes: Annotated[tuple[Mesh, ...], Meta(max_length=MAX_MESHES)] = ()
    cameras: Annotated[tuple[Camera, ...], Meta(max_length=MAX_CAMERAS)] = ()
    layout: Annotated[tuple[Field, ...], Meta(max_length=64)]


class Base(Struct, frozen=True):
    """Pose and twist of a floating base in the world frame; quaternion x y z w, twist linear then angular."""

    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]
    linear_m_s: tuple[float, float, float]
    angular_rad_s: tuple[float, float, float]


class State(Struct, frozen=True, kw_only=True):
    """One state frame. Arrays are in the order of ``Description.joints``; NaN is unknown. Times in nanoseconds."""

    incarnation: Unsigned
    sequence: int
    monotonic_ns: Unsigned
    wall_ns: Unsigned
    base: Base | None = None
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]


class Move(Struct, frozen=True, tag="move", forbid_unknown_fields=True):
    """Move the named joints to absolute positions (rad or m), arriving together, each within its URDF velocity limit.

    ``speeds`` limits some of them further (rad/s or m/s).
    """

    targets: Annotated[dict[Name, float], Meta(min_length=1, max_length=256)]
    speeds: Annotated[dict[Name, Annotated[float, Meta(gt=0)]], Meta(max_length=256)] = {}


class Follow(Struct, frozen=True, tag="follow", forbid_unknown_fields=True):
    """Pass through waypoints: ``positions[i]`` (rad or m, in the order of ``joints``) at ``times_s[i]`` after the
    start.
    """

    joints: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=256)]
    times_s: Annotated[tuple[Annotated[float, Meta(gt=0, le=3600)], ...], Meta(min_length=1, max_length=1000)]
    positions: Annotated[tuple[tuple[float, ...], ...], Meta(min_length=1, max_length=1000)]


class Expectation(Struct, frozen=True, forbid_unknown_fields=True):
    """The position that a joint must have for a command to be executed, and its tolerance (rad or m)."""

    position: float
    tolerance: Annotated[float, Meta(ge=0)]


class Command(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A command for one run of one agent.

    ``seen_ns`` is the agent's monotonic time in the last frame that the gateway had. The agent refuses the command once
    its monotonic clock is past ``seen_ns`` + ``time_to_live_ns``; wall clocks play no role. ``scale`` reduces all
    speeds to that share of what the agent would choose. ``expects`` holds by joint the state that the motion was
    planned for. A rehearsal is checked and answered like a command, but nothing moves.
    """

    version: int
    id: Identifier
    incarnation: Unsigned
    seen_ns: Unsigned
    time_to_live_ns: Annotated[int, Meta(gt=0, le=60_000_000_000)]
    motion: Move | Follow
    scale: Annotated[float, Meta(gt=0, le=1)] = 1.0
    expects: Annotated[dict[Name, Expectation], Meta(max_length=256)] = {}
    rehearsal: bool = False


class Stop(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Brake and hold. A stop is never stale and valid for any run.

    It stops the motion of ``command`` if that is set, else ``joints``, or the whole robot if there are none. ``reason``
    is reported for the motions that it ends.
    """

    version: int
    id: Identifier
    joints: Annotated[tuple[Name, ...], Meta(max_length=1024)] = ()
    command: Annotated[str, Meta(max_length=64)] = ""
    reason: Annotated[str, Meta(max_length=512)] = ""
    rehearsal: bool = False


class PictureQuery(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A request for the present picture of a camera."""

    version: int
    camera: Name
    format: PictureFormat


RefusalCode = Literal[
    "malformed",
    "version",
    "incarnation",
    "stale",
    "unknown-joint",
    "limits",
    "fault",
    "repeated",
    "expectation",
    "unknown-action",
    "input",
]


class Accepted(Struct, frozen=True, tag="accepted"):
    """Acceptance of a command: ``duration_s`` of the motion, and ``preempts``, the commands that it ends.

    ``at_ns`` is the agent's monotonic time of acceptance or stop, comparable to that of its frames.
    """

    id: str
    duration_s: Annotated[float, Meta(ge=0, le=86_400)] = 0.0
    preempts: Annotated[tuple[Identifier, ...], Meta(max_length=1024)] = ()
    at_ns: Unsigned = 0


class Refused(Struct, frozen=True, tag="refused"):
    """Refusal of a command; ``reason`` is a sentence for people: what was wrong and what would be right."""

    id: str
    code: RefusalCode
    reason: Annotated[str, Meta(max_length=1024)]


Reply = Accepted | Refused


MAX_SENSOR_FAULTS = 64


class Condition(Struct, frozen=True, kw_only=True):
    """The condition of a robot, as its agent sees it.

    ``fault`` is why the robot cannot be read or driven now, empty if it can. ``sensors`` has a sentence for each joint
    whose sensor cannot be believed, or that takes no commands now.
    """

    version: int
    incarnation: Unsigned
    fault: Annotated[str, Meta(max_length=1024)] = ""
    sensors: Annotated[dict[Name, Annotated[str, Meta(max_length=512)]], Meta(max_length=MAX_SENSOR_FAULTS)] = {}


class StreamCounts(Struct, frozen=True, kw_only=True):
    """The fate of the samples of a stream: applied, or dropped because they were ``late``, out of order, of the
    future or invalid. ``silent``: none could be used for so long that the action has come to rest, or does.
    """

    applied: Unsigned = 0
    late: Unsigned = 0
    reordered: Unsigned = 0
    future: Unsigned = 0
    invalid: Unsigned = 0
    silent: bool = False


class Progress(Struct, frozen=True, kw_only=True):
    """State of an accepted command; ``positions`` are the measured positions of its joints at ``wall_ns``.

    ``progress`` is the completed share, ``successor`` the command that preempted this one. ``feedback`` and ``result``
    are those of an action of a component, ``stream`` counts the samples of one that was opened as a stream.
    """

    version: int
    id: Identifier
    incarnation: Unsigned
    state: Literal["running", "succeeded", "failed", "cancelled", "preempted"]
    wall_ns: Unsigned
    reason: Annotated[str, Meta(max_length=1024)] = ""
    positions: Annotated[dict[Name, float], Meta(max_length=256)] = {}
    progress: Annotated[float, Meta(ge=0, le=1)] = 0.0
    successor: Annotated[str, Meta(max_length=64)] = ""
    feedback: Raw | UnsetType = UNSET
    result: Raw | UnsetType = UNSET
    stream: StreamCounts | UnsetType = UNSET
