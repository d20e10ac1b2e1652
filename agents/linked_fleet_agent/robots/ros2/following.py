"""Motions that trajectory controllers follow as goals of control_msgs/FollowJointTrajectory."""

import asyncio
import logging
import math
import uuid
from collections.abc import Collection, Coroutine, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from linked_fleet_agent.robot import FollowedEnd
from linked_fleet_agent.robots.ros2.goals import SUCCEEDED, ActionClient, GoalError, goal_id_of
from linked_fleet_agent.trajectory import Trajectory

_log = logging.getLogger(__name__)

LONGEST_STEP_S, MOST_POINTS = 0.1, 10_000
"""Largest time between two points of a goal, and their largest number."""
_ERRORS = {
    -1: "the goal is invalid",
    -2: "the joints are not those of the controller",
    -3: "the time stamp is old",
    -4: "the path tolerance is violated",
    -5: "the goal tolerance is violated",
}


@dataclass
class Way:
    """A controller that follows goals. ``answers`` is False while its action server does not answer.

    Goals have a ``tolerance`` (rad or m) at their end; None leaves it to the controller.
    """

    client: ActionClient
    joints: tuple[str, ...]
    tolerance: float | None = None
    answers: bool = True


class Mover(NamedTuple):
    """An action that moves joints, or ``BASE``, beside those of trajectory controllers."""

    client: ActionClient
    moves: Collection[str]


@dataclass
class _Motion:
    ways: list[Way]
    task: "asyncio.Task[None] | None" = None


@dataclass
class Following:
    """The motions that controllers of one robot follow. For the event loop of the agent.

    A stop cancels the goals of ``movers`` too.
    """

    ways: Sequence[Way] = ()
    movers: Sequence[Mover] = ()
    _running: dict[str, _Motion] = field(default_factory=dict)
    _ended: list[FollowedEnd] = field(default_factory=list)
    _tasks: set["asyncio.Task[None]"] = field(default_factory=set)
    _told: dict[str, str] = field(default_factory=dict)

    @property
    def is_busy(self) -> bool:
        return bool(self._running)

    def follow(self, id: str, trajectories: Mapping[str, Trajectory]) -> bool:
        """Send the trajectories to the controllers of their joints; False if these do not take all of them as goals."""
        ways = [each for each in self.ways if not trajectories.keys().isdisjoint(each.joints)]
        covered = {joint for each in ways for joint in each.joints}
        if covered != trajectories.keys() or not all(each.answers and each.client.is_available for each in ways):
            return False
        for other, motion in list(self._running.items()):
            if any(each in ways for each in motion.ways):
                self._forget(other)  # the new goals replace its own
        motion = self._running[id] = _Motion(ways)
        motion.task = self._start(self._follow(id, motion, trajectories))
        return True

    def leave(self, id: str) -> None:
        """Cancel the goals of a motion."""
        motion = self._forget(id)
        for way in motion.ways if motion is not None else ():
            self._start(self._cancel_unless_replaced(way, _goal_of(id, way)))

    def ended(self) -> Sequence[FollowedEnd]:
        """Return the motions that have ended since the last call."""
        ended, self._ended = self._ended, []
        return ended

    def end_others(self, joints: Collection[str]) -> None:
        """Cancel all goals of the actions that move one of these, also those of other clients.

        Without an event loop, when no agent runs the driver, nobody could wait for the answers: nothing is cancelled.
        """
        self._told.clear()
        if not _has_loop():
            return
        clients = [each.client for each in self.ways if not set(joints).isdisjoint(each.joints)]
        clients += [each.client for each in self.movers if not set(joints).isdisjoint(each.moves)]
        own = {_goal_of(id, way) for id, motion in self._running.items() for way in motion.ways}
        for client in clients:
            if client.is_available:
                self._start(self._cancel_all(client, own))

    @property
    def ended_others(self) -> str:
        """A sentence about what the last ``end_others`` has cancelled."""
        return "; ".join(self._told.values())

    async def probe(self) -> list[str]:
        """Ask whether the action servers answer. Return sentences about those that do not.

        Behind a bridge of DDS, nodes of FastDDS offer actions that do not.
        """
        return [said for said in await asyncio.gather(*map(_probe, self.ways)) if said]

    async def _follow(self, id: str, motion: _Motion, trajectories: Mapping[str, Trajectory]) -> None:
        ends = [self._run(id, way, {name: trajectories[name] for name in way.joints}) for way in motion.ways]
        reasons = [each for each in await asyncio.gather(*ends) if each]
        if self._running.get(id) is motion:
            del self._running[id]
            self._ended.append(FollowedEnd(id, "; ".join(reasons)))

    async def _run(self, id: str, way: Way, trajectories: Mapping[str, Trajectory]) -> str:
        """Let one controller follow trajectories. Return why it has not reached their ends, or an empty string."""
        goal_id = _goal_of(id, way)
        try:
            await way.client.send(goal_id, goal_of(trajectories, way.tolerance))
            end = await way.client.result(goal_id)
        except GoalError as error:
            await self._cancel(way.client, goal_id)
            return str(error)
        if end.status == SUCCEEDED and not end.result["error_code"]:
            return ""
        return _reason(way.client.name, end.result, way.client.feedback(goal_id))

    async def _cancel_unless_replaced(self, way: Way, goal_id: bytes) -> None:
        """Cancel a goal, but not if the next one goes to the same controller: it replaces the goal without a stop."""
        if not any(way in motion.ways for motion in self._running.values()):
            await self._cancel(way.client, goal_id)

    async def _cancel(self, client: ActionClient, goal_id: bytes) -> None:
        try:
            await client.cancel(goal_id)
        except GoalError as error:
            _log.warning("a goal was not cancelled: %s", error)

    async def _cancel_all(self, client: ActionClient, own: Collection[bytes]) -> None:
        try:
            others = [each for each in await client.cancel_all() if each not in own]
        except GoalError as error:
            self._told[client.name] = f"goals of other clients were not cancelled: {error}"
            return
        if others:
            count = f"{len(others)} goals" if len(others) > 1 else "a goal"
            self._told[client.name] = f"{count} of another client of {client.name} cancelled"

    def _forget(self, id: str) -> _Motion | None:
        motion = self._running.pop(id, None)
        if motion is not None and motion.task is not None:
            motion.task.cancel()
        return motion

    def _start(self, work: Coroutine[Any, Any, None]) -> "asyncio.Task[None]":
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task


def _has_loop() -> bool:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


async def _probe(way: Way) -> str:
    """Cancel a goal that nobody has, which every server answers."""
    if not way.client.is_available:
        return ""
    try:
        await way.client.cancel(uuid.uuid4().bytes)
        way.answers = True
    except GoalError as error:
        way.answers = False
        return f"{error}; trajectories go to its topic"
    return ""


def goal_of(trajectories: Mapping[str, Trajectory], tolerance: float | None = None) -> dict[str, Any]:
    """Return the goal of a FollowJointTrajectory: points with positions and velocities, of which the cubics through
    them are the trajectories, and the tolerance of each joint at the end.
    """
    points = [_point(trajectories, at) for at in _times(trajectories.values())]
    goal: dict[str, Any] = {"trajectory": {"joint_names": list(trajectories), "points": points}}
    if tolerance is not None:
        goal["goal_tolerance"] = [{"name": name, "position": tolerance} for name in trajectories]
    return goal


def _times(trajectories: Iterable[Trajectory]) -> list[float]:
    """Return the times of the points: where a segment of any joint begins, and no further apart than allowed."""
    trajectories = list(trajectories)
    last = max(each.duration_s for each in trajectories)
    knots = sorted(
        {segment.start_s for each in trajectories for segment in each.segments if 0.0 < segment.start_s < last}
    )
    step = max(LONGEST_STEP_S, last / (MOST_POINTS / 2))
    found, before = list[float](), 0.0
    for knot in [*knots, max(last, LONGEST_STEP_S)][-MOST_POINTS:]:
        parts = max(1, math.ceil((knot - before) / step - 1e-9))
        found += [before + (knot - before) * part / parts for part in range(1, parts + 1)]
        before = knot
    return found


def _point(trajectories: Mapping[str, Trajectory], at_s: float) -> dict[str, Any]:
    states = [each.at(at_s) for each in trajectories.values()]
    sec, nanosec = divmod(round(at_s * 1e9), 1_000_000_000)
    return {
        "positions": [position for position, _ in states],
        "velocities": [velocity for _, velocity in states],
        "time_from_start": {"sec": sec, "nanosec": nanosec},
    }


def _goal_of(id: str, way: Way) -> bytes:
    return goal_id_of(f"{id} {way.client.name}")


def _reason(name: str, result: Mapping[str, Any], feedback: Mapping[str, Any] | None) -> str:
    code = result["error_code"]
    why = _ERRORS.get(code, "it was ended by another client or by the controller" if not code else f"error {code}")
    more = result["error_string"][:300] or _farthest(feedback)
    return f"{name}: {why}" + (f" ({more})" if more else "")


def _farthest(feedback: Mapping[str, Any] | None) -> str:
    """Return which joint was farthest from its trajectory when the controller told of it last; empty if none was."""
    if feedback is None:
        return ""
    errors = zip(feedback["joint_names"], feedback["error"]["positions"], strict=False)
    found = max(((abs(error), name) for name, error in errors if math.isfinite(error)), default=(0.0, ""))
    return f"{found[1]:.128} was {found[0]:.3g} off its trajectory" if found[0] else ""
