"""A drive along ways of the world, by the action of the base that follows paths."""

import asyncio
from collections.abc import Callable

from linked_fleet_agent import planar
from linked_fleet_agent.wire.kinds import NOT_MOVED, OFF_PATH
from linked_fleet_base.errors import Busy, Conflict, MotionRefused
from linked_fleet_gateway.api import Core, Invocation, InvocationState, Robot
from linked_fleet_gateway.extensions.navigation import floor
from linked_fleet_gateway.extensions.navigation.messages import Way
from linked_fleet_gateway.extensions.navigation.trips import Around, DriveError, Ended, UnplannedError
from linked_fleet_gateway.extensions.world.collisions import Unchecked
from linked_fleet_gateway.extensions.world.path_watch import AHEAD
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.faces import Offer, View, drive_limits, path_offer
from linked_fleet_gateway.serving import Caller, robot_time

_REPORT_S = 0.5


def offer_of(robot: Robot) -> Offer:
    """Return the action by which a base follows paths. Raises Conflict."""
    offer = path_offer(robot)
    if offer is None:
        raise Conflict(f"{robot.name} has no base that follows paths (lf:FollowPath) any more.")
    return offer


class DrivenBase:
    """A base of the fleet, driven for a caller. Implements ``traffic.Base``."""

    def __init__(self, core: Core, world: World, robot: Robot, base: str, caller: Caller, speed: float) -> None:
        self._core, self._world, self._robot, self._base, self._caller = core, world, robot, base, caller
        self._speed, self._lease = speed, _lease_id(robot)
        self.tell: Callable[[planar.Pose], None] = lambda pose: None
        """Called with where it is while it drives."""

    @property
    def name(self) -> str:
        return self._robot.name

    def may_know(self, name: str) -> bool:
        return self._sees.includes(name)

    async def around(self) -> Around:
        if not self._robot.online:
            raise DriveError(f"{self.name} is offline")
        try:
            return await floor.around(self._world, self._robot, self._sees, self._is_lateral)
        except (Busy, Unchecked) as error:
            raise UnplannedError(error.detail.rstrip(".")) from error

    @property
    def _sees(self) -> View:
        return self._caller.visible_robots

    @property
    def _is_lateral(self) -> bool:
        limits = drive_limits(self._robot)
        return limits is not None and limits.lateral > 0.0

    async def follow(self, way: Way) -> Ended:
        """Drive along a way. Raises an error of the gateway if the robot cannot be driven by the caller."""
        try:
            run = await self._begin(way)
        except (MotionRefused, Busy) as error:
            return Ended(refused=error.detail)
        try:
            while not await self._core.wait_until(run, lambda one: one.state.terminal, _REPORT_S):
                if (why := self._lost_control()) and not run.state.terminal:
                    await self._core.cancel(run.id, why)
                    return Ended(failed=why)
                self.tell(floor.standing(self._robot))
                await asyncio.sleep(0)  # it waits no more once the gateway ends, which cancels this
        except asyncio.CancelledError:
            await self._core.cancel(run.id, "the drive to its goal has ended")
            raise
        return ended(run)

    def _lost_control(self) -> str:
        """Return why the caller may not drive it any more, or an empty string."""
        lease = self._robot.lease
        if lease is not None and lease.id != self._lease:
            return f"{lease.holder} has taken control of {self.name}"
        return f"the control lease of {self.name} has ended" if self._lease and lease is None else ""

    async def _begin(self, way: Way) -> Invocation:
        offer = offer_of(self._robot)
        poses = floor.to_odometry(self._robot, way.poses)
        last = len(poses) - 1
        path = [
            {"x": round(each.x, 4), "y": round(each.y, 4)}
            | ({"heading": round(each.heading, 4)} if self._is_lateral or index == last else {})
            for index, each in enumerate(poses)
        ]
        given = {"path": path, "speed": self._speed}
        statements = self._core.statements(offer, self._base, given)
        return await self._core.invoke(offer, self._base, self._caller, statements, robot_time(self._robot))


def _lease_id(robot: Robot) -> str:
    return "" if robot.lease is None else robot.lease.id


def ended(run: Invocation) -> Ended:
    """Return how a followed path has ended."""
    if run.state is InvocationState.SUCCEEDED:
        return Ended(arrived=True)
    if run.reason.startswith(AHEAD):
        return Ended(blocked=run.reason)
    why = run.reason or f"it {run.state}"
    if run.state is InvocationState.FAILED and run.reason.startswith((OFF_PATH, NOT_MOVED)):
        return Ended(lost=f"the base has not followed its way: {why}")
    if run.preempted_by:
        why = "another motion has taken over the base"
    return Ended(failed=f"the base has not followed its way: {why}")
