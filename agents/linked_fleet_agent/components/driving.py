"""The component of a base that takes velocities: it accelerates and brakes within limits, and stops by itself."""

import asyncio
import math
from abc import abstractmethod
from collections.abc import Awaitable, Callable, Sequence
from inspect import signature
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import action, value
from linked_fleet_agent.components.docking import docking, station_at
from linked_fleet_agent.components.input_stream import InputStream
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
from linked_fleet_agent.components.ticks import Ticks
from linked_fleet_agent.path_tracking import PathError, PosesAhead
from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Ramp, Velocity
from linked_fleet_agent.wire import messages
from linked_fleet_agent.wire.components import BASE, StreamLimits

MOST_S, USUAL_S = 1.0, 0.5
"""How long one request of velocities holds, at most and by default."""
_STOP_MARGIN_S = 0.5
_CONTACT_M, _CONTACT_RAD = 0.01, math.radians(1.0)
_TAKE_OVER_TICKS, _SILENCE_S = 3, 2.0


class VelocityBase(Base, blocking=False):
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
        self.ramp = Ramp(self.limits)
        self.pose_now, self.velocity_now = Pose(), STANDING
        self.ahead = PosesAhead()
        self._ticked_s: float | None = None
        self._driver: Call[PlanarTwist] | None = None
        self._ticks = Ticks()

    @property
    def speed_share(self) -> float:
        """The share of its speed that the base uses, of which all parts of a velocity are reduced alike."""
        return 1.0

    @property
    def standing(self) -> bool:
        """True while the base is at rest, and wants to be."""
        return self.ramp.standing

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
        elapsed_s = 0.0 if self._ticked_s is None else max(now_s - self._ticked_s, 0.0)
        self._ticked_s = now_s
        self.pose_now, self.velocity_now = self.measure(elapsed_s)
        self.send(self.ramp.step(now_s, elapsed_s, self.speed_share))
        self._ticks.happen()

    def on_halt(self) -> None:
        """Tell the motors to stand."""
        self.ramp = Ramp(self.limits)
        self.send(STANDING)

    async def _request(self, call: Call[PlanarTwist], wanted: Velocity, duration_s: float) -> None:
        """Drive like this, and end when the base stands, or when a newer request has taken over.

        One that was opened as a stream drives as its samples say, until it is told to end.
        """
        now_s = await self.tick() if self._ticked_s is None else self._ticked_s

        async def drive() -> None:
            self.ramp.request(wanted, now_s + duration_s)
            if call.stream is not None:
                await self._follow_samples(call, call.stream)
            await self._until_standing(call)

        await self.carry_out(call, drive)

    async def carry_out(self, call: Call[Any], drive: Callable[[], Awaitable[None]]) -> None:
        """Let a run drive the base. However it ends, the base comes to rest, or a newer run has taken over."""
        self._driver = call
        try:
            await drive()
            await self._come_to_rest(call)
        except asyncio.CancelledError:
            if call.replaced:
                await self._until_taken_over(call)
            await self._come_to_rest(call)
            raise
        except PathError:
            await self._come_to_rest(call)
            raise

    async def _come_to_rest(self, call: Call[Any]) -> None:
        if self._driver is call:
            self.ramp.brake()
        while self._driver is call and not self.standing:
            await self.tick()

    async def _follow_samples(self, call: Call[PlanarTwist], stream: InputStream) -> None:
        """Drive as samples say. The ramp brakes by itself when one does not hold any more."""
        self.ramp.brake()
        async for given in stream:
            if given is not None:
                velocities = (given.input.get(name, 0.0) for name in Velocity._fields)
                self.ramp.request(Velocity(*velocities), given.until_s)
            call.feedback(self.twist)

    async def _until_standing(self, call: Call[PlanarTwist]) -> None:
        while self._driver is call and not self.standing:
            await self.tick()
            call.feedback(self.twist)

    async def _until_taken_over(self, call: Call[Any]) -> None:
        """Wait for the newer request, which is stopped at times before it begins."""
        for _ in range(_TAKE_OVER_TICKS):
            if self._driver is call:
                await self.tick()

    async def tick(self) -> float:
        """Wait for the next tick, and return its time.

        Raises TimeoutError if the agent ticks no more; its end has halted the motors.
        """
        async with asyncio.timeout(_SILENCE_S):
            await self._ticks.next()
        assert self._ticked_s is not None
        return self._ticked_s


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
        await self._request(call, Velocity(linear, lateral, angular), duration)

    fastest = Velocity(limits.linear, limits.lateral, limits.angular)
    for name, most in fastest._asdict().items():
        drive.__annotations__[name] = Annotated[drive.__annotations__[name], Meta(ge=-most, le=most)]
    offered = signature(drive)
    if not limits.lateral:
        others = [each for each in offered.parameters.values() if each.name != "lateral"]
        drive.__signature__ = offered.replace(parameters=others)  # type: ignore[attr-defined]
    return action(moves=moves, duration_s=MOST_S + stop_s, stop_s=stop_s, takes_over=True, stream=StreamLimits())(drive)


_Duration = Annotated[float, unit("SEC"), Meta(ge=0, le=MOST_S, title="How long the velocities hold")]
