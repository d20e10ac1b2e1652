"""Base classes and types of known kinds of components (``linked_fleet_agent.wire.kinds``).

A subclass writes the members of its kind, and gets the kind and its terms. One that lacks a member, or has it in
another unit, is refused when the agent starts and by ``linked-fleet-agent --check``. Ranges are narrowed by
``Annotated[Width, Meta(le=0.08)]``.
"""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from linked_fleet_agent.components.component import Component, action, event, value
from linked_fleet_agent.components.schemas import unit
from linked_fleet_agent.wire.kinds import LF


def _between(least: float, most: float | None = None) -> Meta:
    """Return a range that a ``Meta`` of a subclass may narrow at both ends."""
    return Meta(extra_json_schema={"minimum": least} | ({} if most is None else {"maximum": most}))


Width = Annotated[float, unit("M"), _between(0), Meta(title="Distance of the fingers")]
Force = Annotated[float, unit("N"), _between(0), Meta(title="Force of the fingers")]
Holding = Annotated[bool, Meta(title="Object held")]
Charge = Annotated[float, unit("PERCENT"), _between(0, 100), Meta(title="Charge")]
Voltage = Annotated[float, unit("V"), Meta(title="Voltage")]
Current = Annotated[float, unit("A"), Meta(title="Current")]
PowerSupplyState = Annotated[Literal["charging", "discharging", "full", "unknown"], Meta(title="Power supply state")]
OperationalMode = Annotated[Literal["manual", "automatic"], Meta(title="Operational mode")]
SpeedScale = Annotated[float, _between(0, 1), Meta(title="Speed scale")]
Metres = Annotated[float, unit("M")]
Linear = Annotated[float, unit("M-PER-SEC"), Meta(title="Forward velocity")]
Lateral = Annotated[float, unit("M-PER-SEC"), Meta(title="Velocity to the left")]
Angular = Annotated[float, unit("RAD-PER-SEC"), Meta(title="Angular velocity, counterclockwise")]
Level = Literal["ok", "warning", "error", "stale"]


class Grasped(Struct, omit_defaults=True):
    """The result of a grasp. A grasp that stalls on an object is a success that holds it."""

    width: Width
    holding: Holding
    force: Force | None = None


class Status(Struct):
    """The state of one part of a robot; ``message`` is for people."""

    name: Annotated[str, Meta(max_length=128)]
    level: Level
    message: Annotated[str, Meta(max_length=1024)]


class PlanarPose(Struct):
    """Position and heading of a base in its odometry frame."""

    x: Metres
    y: Metres
    heading: Annotated[float, unit("RAD"), Meta(title="Heading, counterclockwise")]


class PlanarTwist(Struct):
    """Velocity of a base in its own frame."""

    linear: Linear
    lateral: Lateral
    angular: Angular


class PlanarLimits(Struct, rename="camel"):
    """The most that a base drives, and by how much it accelerates and brakes."""

    linear: Linear
    lateral: Lateral
    angular: Angular
    linear_acceleration: Annotated[float, unit("M-PER-SEC2"), Meta(title="Linear acceleration")]
    angular_acceleration: Annotated[float, unit("RAD-PER-SEC2"), Meta(title="Angular acceleration")]


class Corner(Struct):
    """A corner of a footprint, in the frame of the base."""

    x: Metres
    y: Metres


_FAR_M = 10_000.0
_Near = Annotated[float, unit("M"), Meta(ge=-_FAR_M, le=_FAR_M)]
PathSpeed = Annotated[float, Meta(ge=0.05, le=1, title="Share of the speed of the base")]


class PathPose(Struct):
    """A pose of a path in the odometry frame. Without a heading, the base looks as it comes there."""

    x: _Near
    y: _Near
    heading: Annotated[float, unit("RAD"), Meta(title="Heading, counterclockwise")] | None = None


class Arrived(Struct, rename="camel"):
    """The result of a drive to a pose: how far from it the base stands, by its odometry."""

    error: Annotated[float, unit("M"), _between(0), Meta(title="Distance from the pose")]
    heading_error: Annotated[float, unit("RAD"), _between(0), Meta(title="Error of the heading")]


StationName = Annotated[str, Meta(max_length=64, title="Name of a charging station")]


class Station(Struct):
    """A charging station: the pose, in the odometry frame, of a base that is docked there.

    The way into it is straight, over ``approach`` metres.
    """

    name: Annotated[str, Meta(min_length=1, max_length=64, title="Name of the charging station")]
    x: _Near
    y: _Near
    heading: Annotated[float, unit("RAD"), Meta(title="Heading, counterclockwise")]
    approach: Annotated[float, unit("M"), Meta(ge=0.1, le=2, title="Length of the straight way into it")] = 0.4


class Docked(Arrived, rename="camel"):
    """The result of docking: the station, and how far from its pose the base stands, by its odometry."""

    station: StationName


class Gripper(Component, kind=LF + "Gripper", rename="camel"):
    """A gripper.

    Write the values ``width``, ``force`` (NaN if it is not known) and ``holding``, and the actions
    ``grasp(width, force) -> Grasped`` and ``open(width)``, whose parameters have defaults.
    """

    lost: event[None] = event(title="Object lost", description="What was held is not between the fingers any more.")


class Battery(Component, kind=LF + "Battery", rename="camel", rate_hz=1):
    """A battery. Write the values ``charge`` and ``powerSupplyState``, and ``voltage`` and ``current`` if known.

    As everywhere in classes of kinds, the names are spelt in the way of Python, with low lines.
    """


class Switch(Component, kind=LF + "Switch", rename="camel"):
    """One channel of digital signals: write ``output`` with its setter, ``input``, or both.

    A box of channels has a component for each, so that each has a name, a title, rights and subscriptions of its own,
    and setting one does not touch the others.
    """


class Mode(Component, kind=LF + "Mode", rename="camel", rate_hz=5, blocking=False):
    """Operational mode and protective stop of a robot.

    The agent moves nothing while ``prevents_motion`` has a reason, which is the protective stop. This class keeps all
    of it in software: ``stop_protectively`` begins the stop, ``reset`` ends it. A driver whose controller has modes and
    stops of its own writes ``prevents_motion``, and what else is different there.
    """

    operational_mode: OperationalMode = "automatic"

    @value
    def mode(self) -> OperationalMode:
        """Operate by hand, or by programs and clients."""
        return self.operational_mode

    @mode.setter
    def set_mode(self, mode: OperationalMode) -> None:
        self.operational_mode = mode

    @value
    def protective_stop(self) -> Annotated[bool, Meta(title="Protective stop")]:
        """Tell whether the robot stands because of a protective stop."""
        return bool(self.prevents_motion)

    @value
    def reason(self) -> Annotated[str, Meta(title="Reason of the protective stop", max_length=1024)]:
        """Tell why the robot stands, empty if no protective stop is active."""
        return self.prevents_motion[:1024]

    @value
    def speed_scale(self) -> SpeedScale:
        """Return the share of its speed that the robot uses."""
        return 1.0

    @action()
    async def reset(self) -> None:
        """End the protective stop. Nothing moves by it, and ended motions do not go on."""
        self.prevents_motion = ""

    def stop_protectively(self, reason: str) -> None:
        """Begin a protective stop."""
        self.prevents_motion = reason


class Diagnostics(Component, kind=LF + "Diagnostics", rename="camel", rate_hz=1):
    """The states of the parts of a robot. Write the value ``status``, a list of ``Status``."""


class Base(Component, kind=LF + "Base", rename="camel", rate_hz=10):
    """A base that drives in the plane.

    Write the values ``pose`` (in its odometry frame), ``twist`` and ``footprint`` (corners, counterclockwise), if
    possible ``drive_limits``, without which gateways do not know how it brakes and check no way for collisions, and
    ``path``, the poses that it has yet to pass, by which gateways keep others off its way. Write the action
    ``drive(linear, angular, duration)``, which moves ``BASE``, whose parameters have defaults, and which lasts a
    second at most. It may have ``follow_path(path, speed) -> Arrived``, and, if it charges at stations, the values
    ``stations`` and ``docked_at`` (empty while it is not docked) and the actions ``dock(station) -> Docked`` and
    ``undock()``. ``linked_fleet_agent.components.driving`` has all of it for a base that takes velocities.
    """
