"""Motions of robots that keep their times: of which it is known when they are where.

A motion of joints does so if this gateway has accepted it from rest, its agent has said that it runs, and its latest
frame is fresh and shows the joints where they are to be. Of every other one it is unknown when it is where.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from linked_fleet_gateway.api import Invocation, InvocationState
from linked_fleet_gateway.extensions.world.course import Course
from linked_fleet_gateway.extensions.world.messages import Positions
from linked_fleet_state.model import JointKind
from linked_fleet_state.robot import Robot

BEHIND_S, AHEAD_S = 0.5, 0.1
"""Largest delay and lead of a motion that keeps its times."""
FRESH_S = 0.3
"""The greatest age of the frame that shows this."""
START_S = 0.5
"""A motion that relies on the times of others begins within this time, or is refused by its agent."""
LATE_S, EARLY_S = 1.5, 2.0
"""Another robot is met up to so much later and earlier than at its time.

After the other robot: it is BEHIND_S late, and then stands; that is seen, checked and stopped within another second.
Before it: the robot itself is START_S and BEHIND_S late, and then stands; the other one is stopped within a second.
"""
_TOLERANCE_RAD, _TOLERANCE_M = 0.01, 0.002
_SAME_S, _SAME_SHARE = 0.1, 0.01
"""By how much the duration that an agent states may differ from that of the course."""
_MOST_KEPT = 8
_ALWAYS = math.inf

OpenOf = Callable[[str], list[Invocation]]


class Run(NamedTuple):
    """A motion of a robot: their names."""

    robot: str
    invocation: str


class OnTime(NamedTuple):
    """A motion that keeps its times: it is ``elapsed_s`` after its start, as a frame has shown ``age_s`` ago."""

    run: Run
    course: Course
    elapsed_s: float
    age_s: float

    @property
    def left_s(self) -> float:
        return max(0.0, self.course.duration_s - self.elapsed_s)

    def met(self) -> tuple[tuple[Positions, ...], tuple[tuple[float, float], ...]]:
        """Return the places on its way, and from when until when it may be met in each, in seconds from now.

        The first one is where it was BEHIND_S ago: it may be there still.
        """
        from_s = max(0.0, self.elapsed_s - BEHIND_S)
        places = [(0.0, self.course.at(from_s)), *self.course.places(from_s)]
        times_s = [from_s + after_s - self.elapsed_s for after_s, _ in places]
        late_s = LATE_S + self.age_s
        froms = [-_ALWAYS, *(each - EARLY_S for each in times_s[:-1])]
        untils = [*(each + late_s for each in times_s[1:]), _ALWAYS]
        return tuple(each for _, each in places), tuple(zip(froms, untils, strict=True))


class Schedules:
    """The courses of the motions that this gateway has let begin."""

    def __init__(self, open_of: OpenOf, now_ns: Callable[[], int] = lambda: time.time_ns()) -> None:
        self._open_of, self._now_ns = open_of, now_ns
        self._begun = dict[str, dict[str, Course]]()

    def begin(self, robot: Robot, own: str, course: Course) -> None:
        """Keep the course of a motion that is about to begin."""
        held = self._begun.setdefault(robot.name, {})
        still = {each.id for each in self._open_of(robot.name)}
        for id in [id for id in held if id not in still][:-_MOST_KEPT]:
            del held[id]
        held[own] = course

    def course(self, run: Run) -> Course | None:
        return self._begun.get(run.robot, {}).get(run.invocation)

    def along(self, robot: Robot) -> Iterator[Positions]:
        """Yield the places ahead on trajectories of a robot, which are not on the straight way to their ends."""
        for each in self._open_of(robot.name):
            course = self.course(Run(robot.name, each.id))
            if course is not None and len(course.legs) > 1:
                yield from (at for _, at in course.places(course.reached_s(robot.positions)))

    def on_time(self, robot: Robot) -> OnTime | None:
        """Return the one motion of a robot that keeps its times; None if there is none, or another one too."""
        motions = [each for each in self._open_of(robot.name) if each.is_motion]
        if len(motions) != 1 or motions[0].state is not InvocationState.RUNNING or not robot.online:
            return None
        run = Run(robot.name, motions[0].id)
        course = self.course(run)
        return None if course is None else self._kept(robot, run, motions[0], course)

    def _kept(self, robot: Robot, run: Run, motion: Invocation, course: Course) -> OnTime | None:
        robot.adopt_latest_frame()
        seen_ns, wall_ns = robot.received_ns, robot.wall_ns
        if seen_ns is None or wall_ns is None or motion.started_ns is None or motion.duration_s is None:
            return None
        age_s = (self._now_ns() - seen_ns) / 1e9
        differs_s = abs(motion.duration_s - course.duration_s)
        if not 0.0 <= age_s <= FRESH_S or differs_s > _SAME_S + _SAME_SHARE * course.duration_s:
            return None
        shown_s = (wall_ns - motion.started_ns) / 1e9
        if shown_s < 0.0 or not _is_there(robot, course, shown_s):
            return None
        return OnTime(run, course, shown_s + age_s, age_s)


def _is_there(robot: Robot, course: Course, shown_s: float) -> bool:
    """Return True if the joints are where they are to be, at a time that is at most BEHIND_S and AHEAD_S off."""
    return all(_is_within(robot, name, course, shown_s) for name in course.end)


def _is_within(robot: Robot, name: str, course: Course, shown_s: float) -> bool:
    assert robot.model is not None
    low, high = course.span(name, max(0.0, shown_s - BEHIND_S), shown_s + AHEAD_S)
    linear = robot.model.joints[name].kind is JointKind.PRISMATIC
    off = _TOLERANCE_M if linear else _TOLERANCE_RAD
    return low - off <= robot.positions.get(name, math.nan) <= high + off


def arrival_s(robots: Iterable[OnTime]) -> float:
    """Return in how many seconds all of these motions have ended, late ones too."""
    return max((each.left_s for each in robots), default=0.0) + LATE_S
