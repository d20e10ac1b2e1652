"""Checks of motions of joints among robots whose running motions keep their times.

A motion that is free although others were everywhere on their ways at all times relies on nothing. One that is not is
checked again, with the others where they are in time. If that is free, the motion relies on the times of the others,
and these on its own times: each pair is watched (``motion_watch.py``).
"""

import time
from collections.abc import Awaitable, Callable
from typing import NamedTuple

from msgspec.structs import replace

from linked_fleet_gateway.api import Motion
from linked_fleet_gateway.extensions.world.course import Course
from linked_fleet_gateway.extensions.world.messages import Answer, Check, CollisionFound, Free
from linked_fleet_gateway.extensions.world.questions import Questions
from linked_fleet_gateway.extensions.world.schedules import START_S, OnTime, Run, Schedules, arrival_s
from linked_fleet_gateway.faces import View
from linked_fleet_gateway.serving import Act
from linked_fleet_state.robot import Robot

Ask = Callable[[Check], Awaitable[Answer]]


class Judged(NamedTuple):
    """The finding about a motion.

    It relies on the ``others``, and begins before ``until_ns`` of the clock of its robot. One that is not free now is
    free ``after_s``, if that is known.
    """

    answer: Answer
    course: Course | None = None
    others: tuple[Run, ...] = ()
    until_ns: int = 0
    after_s: float | None = None


class Pair(NamedTuple):
    """Two motions that rely on each other's times: ``one`` was accepted while the ``other`` was running."""

    one: Run
    other: Run


class InTime:
    """Checks motions in time; it keeps their courses in ``schedules``, and the ``pairs`` that rely on each other."""

    def __init__(self, questions: Questions, schedules: Schedules, ask: Ask) -> None:
        self._questions, self._schedules, self._ask = questions, schedules, ask
        self.pairs = dict[Pair, float]()
        """With the monotonic time (s) at which each was found free."""

    async def judge(
        self, motion: Motion, robots: list[Robot], sees: View, own: str, *, closest_s: float = 0.0
    ) -> Judged:
        """Check a motion, among others at all times first.

        One of joints that is rehearsed is searched for ``closest_s`` seconds for where it comes closest to something.
        """
        asked = self._questions.about(motion, robots, sees, own)
        if not own and not isinstance(motion.motion, Act):
            asked = replace(asked, closest_within_s=closest_s)
        answer, course = await self._ask(asked), self._questions.course(motion, own)
        others = [each for each in robots if each is not motion.robot]
        if not _meets_robot(answer) or not self._questions.on_time(others):
            return Judged(answer, course)
        return await self._judge_in_time(motion, robots, sees, own, Judged(answer))

    async def _judge_in_time(
        self, motion: Motion, robots: list[Robot], sees: View, own: str, refused: Judged
    ) -> Judged:
        # The others have moved on meanwhile.
        asked, course = self._questions.about(motion, robots, sees, own), self._questions.course(motion, own)
        on_time = self._questions.on_time([each for each in robots if each is not motion.robot])
        if course is not None and on_time:
            assert motion.robot.frame is not None
            until_ns = motion.robot.frame.monotonic_ns + round(START_S * 1e9)
            answer = await self._ask(self._questions.in_time(asked, course.legs, robots, on_time))
            if isinstance(answer, Free):
                return Judged(answer, course, tuple(each.run for each in on_time.values()), until_ns)
            refused = Judged(answer)
        seen = {name: each for name, each in on_time.items() if sees.includes(name)}  # nobody learns when others arrive
        return refused._replace(after_s=await self._free_after_s(asked, robots, seen))

    async def _free_after_s(self, asked: Check, robots: list[Robot], on_time: dict[str, OnTime]) -> float | None:
        """Return when the way will be free, if it is once those that keep their times have arrived."""
        after_s = arrival_s(on_time.values())
        answer = await self._ask(self._questions.afterwards(asked, robots, on_time)) if on_time else None
        return after_s if isinstance(answer, Free) else None

    def begin(self, robot: Robot, own: str, judged: Judged) -> None:
        """Keep the course of a motion that was found free, and on whom it relies."""
        if judged.course is None:
            return
        self._schedules.begin(robot, own, judged.course)
        now_s = time.monotonic()
        self.pairs |= {Pair(Run(robot.name, own), other): now_s for other in judged.others}


def _meets_robot(answer: Answer) -> bool:
    return isinstance(answer, CollisionFound) and answer.kind == "robot"
