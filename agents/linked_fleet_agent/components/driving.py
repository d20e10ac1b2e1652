"""The component of a base that takes velocities: it accelerates and brakes within limits, and stops by itself."""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from inspect import signature
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import action, value
from linked_fleet_agent.components.docking import docking, station_at
from linked_fleet_agent.components.kinds import (
    Angular,
    Base,
    Corner,
    Lateral,
    Linear,
    PathPose,
    PlanarLimits,
    PlanarPose,
    PlanarTwist,
    Station,
)
from linked_fleet_agent.components.path_following import following
from linked_fleet_agent.components.schemas import unit
from linked_fleet_agent.components.velocity_runs import VelocityRuns
from linked_fleet_agent.path_tracking import PosesAhead
from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Ramp, Velocity
from linked_fleet_agent.wire import messages
from linked_fleet_agent.wire.components import BASE, StreamLimits

MOST_S, USUAL_S = 1.0, 0.5
"""Time that one request of velocities holds, at most and by default."""
_STOP_MARGIN_S = 0.5
_CONTACT_M, _CONTACT_RAD = 0.01, math.radians(1.0)


class VelocityBase(VelocityRuns, Base, blocking=False):
    """A base that takes velocities.

    A subclass names its ``limits`` and its ``corners`` (m), and writes ``send`` and ``measure``. A request of
    velocities holds for a second at most; without a new one the base brakes within its limits. A newer request takes
    over the speed. It also follows paths. The velocity is sent in each tick of the agent. The motors must stop by
    themselves when nothing comes any more, because the process of an agent can end at any time.

    ``moves`` are joints that move with the base, such as those of legs, and ``settles_s`` is the time that it takes to
    come to rest after its velocity is zero.

    One that ``docks`` writes ``known_stations``, and ``station_in_contact`` if it measures the contact.
    """

    name = "mobile_base"  # links are often called "base"
    limits: ClassVar[DriveLimits]
    corners: ClassVar[tuple[tuple[float, float], ...]]

    def __init_subclass__(
        cls,
        *,
        limits: DriveLimits,
        moves: Sequence[str] = (BASE,),
        settles_s: float = 0.0,
        docks: bool = False,
        **options: Any,
    ) -> None:
        super().__init_subclass__(**options)
        cls.limits = limits
        fastest = Velocity(limits.linear, limits.lateral, limits.angular)
        stop_s = limits.braking_s(fastest) + settles_s + _STOP_MARGIN_S
        cls.drive = _drive(limits, moves, stop_s)  # type: ignore[attr-defined]
        cls.follow_path = following(limits, moves, stop_s)  # type: ignore[attr-defined]
        for name, member in docking(limits, moves, stop_s).items() if docks else ():
            setattr(cls, name, member)

    def __init__(self) -> None:
        super().__init__()
        self.ramp = Ramp(self.limits)
        self.pose_now, self.velocity_now = Pose(), STANDING
        self.ahead = PosesAhead()

    @property
    def speed_share(self) -> float:
        """The share of its speed that the base uses, of which all parts of a velocity are reduced alike."""
        return 1.0

    @property
    def standing(self) -> bool:
        return self.ramp.standing

    def request(self, given: Mapping[str, Any], until_s: float) -> None:
        self.ramp.request(Velocity(*(given.get(name, 0.0) for name in Velocity._fields)), until_s)

    def brake(self) -> None:
        self.ramp.brake()

    def tell(self, call: Call[Any]) -> None:
        call.feedback(self.twist)

    @abstractmethod
    def send(self, velocity: Velocity) -> None:
        """Give this velocity to the motors."""

    @abstractmethod
    def measure(self, elapsed_s: float) -> tuple[Pose, Velocity]:
        """Return the measured pose in the odometry frame, and the measured velocity."""

    def known_stations(self) -> Sequence[Station]:
        """Return the charging stations, as the base sees them now. Names are unique."""
        return ()

    def station_in_contact(self) -> str:
        """Return the name of the station that charges the base, empty if none does; by its odometry alone here."""
        return station_at(self.pose_now, self.known_stations(), _CONTACT_M, _CONTACT_RAD)

    @value
    def pose(self) -> PlanarPose:
        """Return where the base is in its odometry frame."""
        x, y, heading = self.pose_now
        return PlanarPose(round(x, 4), round(y, 4), round(heading, 4))

    @value
    def twist(self) -> PlanarTwist:
        """Return the measured velocity."""
        return PlanarTwist(*(round(each, 3) + 0.0 for each in self.velocity_now))

    @value
    def footprint(self) -> list[Corner]:
        """Return the corners of the base on the floor, counterclockwise."""
        return [Corner(x, y) for x, y in self.corners]

    @value
    def drive_limits(self) -> PlanarLimits:
        """Return the most that it drives, and by how much it accelerates and brakes."""
        most = self.limits
        return PlanarLimits(
            most.linear, most.lateral, most.angular, most.linear_acceleration, most.angular_acceleration
        )

    @value
    def path(self) -> list[PathPose]:
        """Return the poses that it has yet to pass on the path that it follows; none if it follows none."""
        return [PathPose(round(each.x, 4), round(each.y, 4), round(each.heading, 4)) for each in self.ahead.poses]

    @property
    def reading(self) -> messages.Base:
        """Pose and twist for state frames."""
        return planar_base(self.pose_now, self.velocity_now)

    def on_tick(self, now_s: float) -> None:
        elapsed_s = 0.0 if self.ticked_s is None else max(now_s - self.ticked_s, 0.0)
        self.pose_now, self.velocity_now = self.measure(elapsed_s)
        self.send(self.ramp.step(now_s, elapsed_s, self.speed_share))
        self.note_tick(now_s)

    def on_halt(self) -> None:
        """Tell the motors to stand."""
        self.ramp = Ramp(self.limits)
        self.send(STANDING)


def planar_base(pose: Pose, velocity: Velocity) -> messages.Base:
    """Return pose and twist for state frames."""
    x, y, heading = pose
    along_x, along_y, angular = velocity.turned(heading)
    return messages.Base(
        (x, y, 0.0),
        (0.0, 0.0, math.sin(heading / 2.0), math.cos(heading / 2.0)),
        (along_x, along_y, 0.0),
        (0.0, 0.0, angular),
    )


def _drive(limits: DriveLimits, moves: Sequence[str], stop_s: float) -> Any:
    """Return the action with the ranges of its velocities and the time that braking takes."""

    async def drive(
        self: VelocityBase,
        call: Call[PlanarTwist],
        linear: Linear = 0.0,
        lateral: Lateral = 0.0,
        angular: Angular = 0.0,
        duration: _Duration = USUAL_S,
    ) -> None:
        """Drive with these velocities for a short time, then brake. A newer request takes over the speed.

        The samples of a stream hold for its time of silence, whatever their duration.
        """
        await self.hold_for(call, {"linear": linear, "lateral": lateral, "angular": angular}, duration)

    fastest = Velocity(limits.linear, limits.lateral, limits.angular)
    for name, most in fastest._asdict().items():
        drive.__annotations__[name] = Annotated[drive.__annotations__[name], Meta(ge=-most, le=most)]
    offered = signature(drive)
    if not limits.lateral:
        others = [each for each in offered.parameters.values() if each.name != "lateral"]
        drive.__signature__ = offered.replace(parameters=others)  # type: ignore[attr-defined]
    return action(moves=moves, duration_s=MOST_S + stop_s, stop_s=stop_s, takes_over=True, stream=StreamLimits())(drive)


_Duration = Annotated[float, unit("SEC"), Meta(ge=0, le=MOST_S, title="How long the velocities hold")]
