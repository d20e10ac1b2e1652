"""The messages between agents and gateways (PROTOCOL.md). SI units; angles in radian, lengths in metre."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

WIRE_VERSION = 1
MIN_WIRE_VERSION = 1

Name = Annotated[str, Meta(min_length=1, max_length=128)]
Identifier = Annotated[str, Meta(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9-]+\Z")]
Unsigned = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Text = Annotated[str, Meta(max_length=65_536)]


class Field(Struct, frozen=True, forbid_unknown_fields=True):
    """One run of equal values in the binary frame: ``count`` values of ``type`` from byte ``offset``."""

    name: Name
    type: Literal["char2", "uint16", "uint64", "int64", "float64"]
    offset: Unsigned
    count: Unsigned


class Description(Struct, frozen=True, kw_only=True):
    """What an agent says of its robot; ``joints`` is the order of the arrays in its state frames."""

    version: int
    robot: Name
    incarnation: Unsigned
    title: Annotated[str, Meta(max_length=256)]
    urdf: Annotated[str, Meta(max_length=8_000_000)]
    base: Literal["fixed", "floating"] = "fixed"
    joints: Annotated[tuple[Name, ...], Meta(max_length=1024)]
    rate_hz: Annotated[float, Meta(gt=0, le=10_000)]
    capabilities: tuple[Literal["move"], ...] = ()
    annotations: Text = ""
    layout: Annotated[tuple[Field, ...], Meta(max_length=64)]


class Base(Struct, frozen=True):
    """Pose and twist of a floating base in the world frame; quaternion x y z w, twist linear then angular."""

    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]
    linear_m_s: tuple[float, float, float]
    angular_rad_s: tuple[float, float, float]


class State(Struct, frozen=True, kw_only=True):
    """One frame. Arrays are in the order of ``Description.joints``; NaN is unknown. Times in nanoseconds."""

    incarnation: int
    sequence: int
    monotonic_ns: int
    wall_ns: int
    base: Base | None = None
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]


class Move(Struct, frozen=True, tag="move", forbid_unknown_fields=True):
    """Bring the named joints to absolute positions (rad or m), none faster than its URDF limit."""

    targets: Annotated[dict[Name, float], Meta(min_length=1, max_length=256)]


class Command(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A command for one run of one agent.

    ``seen_ns`` is the agent's own monotonic time in the last frame that the gateway had; the agent refuses the
    command once its monotonic clock is past ``seen_ns`` + ``time_to_live_ns``. Wall clocks decide nothing.
    """

    version: int
    id: Identifier
    incarnation: Unsigned
    seen_ns: Unsigned
    time_to_live_ns: Annotated[int, Meta(gt=0, le=60_000_000_000)]
    motion: Move


RefusalCode = Literal["malformed", "version", "incarnation", "stale", "unknown-joint", "limits", "fault", "repeated"]


class Accepted(Struct, frozen=True, tag="accepted"):
    id: str


class Refused(Struct, frozen=True, tag="refused"):
    """``reason`` is a sentence for a human: what was wrong and what would have been right."""

    id: str
    code: RefusalCode
    reason: Annotated[str, Meta(max_length=1024)]


Reply = Accepted | Refused


class Progress(Struct, frozen=True, kw_only=True):
    """State of an accepted command; ``positions`` are the measured positions of its joints at ``wall_ns``."""

    version: int
    id: Identifier
    incarnation: Unsigned
    state: Literal["running", "succeeded", "failed", "preempted"]
    wall_ns: int
    reason: Annotated[str, Meta(max_length=1024)] = ""
    positions: Annotated[dict[Name, float], Meta(max_length=256)] = {}
