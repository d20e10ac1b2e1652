"""The action of a base that follows a path: the agent tracks it, without a gateway between its poses."""

import math
from collections.abc import Sequence
from inspect import signature
from typing import Annotated, Any, Protocol

from msgspec import Meta

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import action
from linked_fleet_agent.components.kinds import Arrived, PathPose, PathSpeed, PlanarPose
from linked_fleet_agent.path_tracking import PathError, PosesAhead, Tracker, from_here
from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Ramp, Velocity
from linked_fleet_agent.wire.kinds import NOT_MOVED

MOST_POSES = 64
LONGEST_S = 3600.0
_HOLD_S = 0.1
"""Time that a velocity holds, so that a base brakes whose path is not tracked any more."""
_STUCK_S, _STUCK_M_RAD = 5.0, 0.002
Path = Annotated[list[PathPose], Meta(min_length=1, max_length=MOST_POSES, title="Path")]
Reverse = Annotated[bool, Meta(title="Drive backwards")]


class Driving(Protocol):
    """The members of a base that takes velocities which this action needs."""

    ramp: Ramp
    pose_now: Pose
    ahead: PosesAhead

    @property
    def limits(self) -> DriveLimits: ...
    @property
    def speed_share(self) -> float: ...
    @property
    def standing(self) -> bool: ...
    @property
    def pose(self) -> PlanarPose: ...
    async def tick(self) -> float: ...


class Reports(Protocol):
    """Takes what is said while a path is followed, as a ``Call`` does."""

    def progress(self, share: float, /) -> None: ...
    def feedback(self, value: PlanarPose, /) -> None: ...


class Watch:
    """Notices that a base does not move."""

    def __init__(self) -> None:
        self._pose, self._since_s = Pose(), float("nan")

    def check(self, pose: Pose, now_s: float) -> None:
        """Raise PathError if the base has been where it is for too long."""
        moved = max(abs(now - before) for now, before in zip(pose, self._pose, strict=True))
        if moved > _STUCK_M_RAD or not self._since_s <= now_s:
            self._pose, self._since_s = pose, now_s
        elif now_s - self._since_s > _STUCK_S:
            raise PathError(f"{NOT_MOVED} for {_STUCK_S:g} s, although it should")


async def follow(base: Driving, call: Reports, tracker: Tracker) -> None:
    """Drive along a path until the base stands at its end. Raises PathError if it cannot go on."""
    watch = Watch()
    while not tracker.finished:
        now_s = await base.tick()
        base.ahead.advance(base.pose_now)
        share = base.speed_share
        wanted = tracker.wanted(base.pose_now, base.ramp.velocity, now_s, share)
        # The ramp takes the same share of all that is requested.
        base.ramp.request(Velocity(*(each / share for each in wanted)), now_s + _HOLD_S)
        watch.check(base.pose_now, now_s)
        call.progress(tracker.share)
        call.feedback(base.pose)


async def track(base: Driving, call: Reports, path: Sequence[Pose], speed: float = 1.0, reverse: bool = False) -> None:
    """Follow a path from where the base is. One that moves goes on, or stops first if it moves otherwise."""
    tracker, moving = None, base.ramp.velocity
    ahead = base.ahead = PosesAhead(base.pose_now, path)
    try:
        if moving != STANDING:
            tracker = Tracker(base.pose_now, from_here(base.pose_now, path), base.limits, speed, reverse)
            tracker = tracker if tracker.join(moving) else None
        if tracker is None:
            await stand(base)
            tracker = Tracker(base.pose_now, path, base.limits, speed, reverse)
        await follow(base, call, tracker)
    finally:
        ahead.clear()


async def stand(base: Driving) -> None:
    """Brake, and wait until the base is at rest."""
    base.ramp.brake()
    while not base.standing:
        await base.tick()


def duration_s(base: Driving, path: Sequence[Pose], speed: float, reverse: bool = False) -> float:
    """Return how long a path takes. Raises ValueError if that is too long."""
    takes_s = Tracker(base.pose_now, path, base.limits, speed * base.speed_share, reverse).duration_s
    if takes_s > LONGEST_S:
        raise ValueError(f"the path takes {takes_s:.0f} s; {LONGEST_S:.0f} s is the most")
    return takes_s


def poses_of(base: Driving, path: Sequence[PathPose], reverse: bool = False) -> list[Pose]:
    """Return the poses of a path, with the headings that the base has there if none are given."""
    poses = [base.pose_now]
    for each in path:
        heading, before = each.heading, poses[-1]
        if heading is None:
            heading = before.heading
            if not base.limits.lateral and math.hypot(each.x - before.x, each.y - before.y) > 0.0:
                heading = math.atan2(each.y - before.y, each.x - before.x) + (math.pi if reverse else 0.0)
        poses.append(Pose(each.x, each.y, heading))
    return poses[1:]


def error_of(pose: Pose, target: Pose) -> Arrived:
    """Return how far a pose is from the one that was to be reached."""
    distance_m, turn_rad = target.error_of(pose)
    return Arrived(round(distance_m, 4), round(turn_rad, 4))


def following(limits: DriveLimits, moves: Sequence[str], stop_s: float) -> Any:
    """Return the action for a base with these limits, which takes so long to come to rest."""

    def rehearse(self: Any, path: Path, speed: PathSpeed = 1.0, reverse: Reverse = False) -> float:
        return duration_s(self, poses_of(self, path, reverse), speed, reverse)

    async def follow_path(
        self: Any, call: Call[PlanarPose], path: Path, speed: PathSpeed = 1.0, reverse: Reverse = False
    ) -> Arrived:
        """Follow a path of poses in the odometry frame, and stop at the last one. Corners are cut by 5 cm at most.

        A base that cannot drive sideways looks along the path, or away from it if it drives backwards.
        """
        poses = poses_of(self, path, reverse)
        rehearse(self, path, speed, reverse)
        await self.carry_out(call, lambda: track(self, call, poses, speed, reverse))
        return error_of(self.pose_now, poses[-1])

    if limits.lateral:
        offered = signature(follow_path)
        others = [each for each in offered.parameters.values() if each.name != "reverse"]
        follow_path.__signature__ = offered.replace(parameters=others)  # type: ignore[attr-defined]
    longest_s = LONGEST_S + stop_s
    return action(moves=moves, duration_s=longest_s, stop_s=stop_s, takes_over=True, rehearse=rehearse)(follow_path)
