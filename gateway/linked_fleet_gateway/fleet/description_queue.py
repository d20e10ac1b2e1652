"""The order in which agents are asked for their descriptions. Pure: times in seconds are handed in.

A question to an agent that does not answer lasts until its time-out. So that thousands of such agents do not delay
one that answers, the number of questions at once is bounded, first questions come before repeated ones, fewer
repetitions before more, and repeated questions have their own, lower bounds in number and rate. Every second first
question goes to the robot that came last: one that comes after a flood does not wait until all of that is asked.
"""

from collections import OrderedDict
from dataclasses import dataclass

BACKOFF_S = (0.1, 0.2, 0.5, 1.0, 2.0)
"""Waiting times before the repetitions of a question; the last one for ever."""


@dataclass(frozen=True)
class Bounds:
    """``open``: questions at once; ``repeated``: those of them that may be repetitions; ``repeats_hz``: their rate."""

    open: int
    repeated: int
    repeats_hz: float


class DescriptionQueue:
    """Robots that have to be asked. A robot is waiting, or being asked, or not in the queue."""

    def __init__(self, bounds: Bounds) -> None:
        self._bounds = bounds
        self._waiting = [OrderedDict[str, float]() for _ in range(len(BACKOFF_S) + 1)]
        """By the number of questions asked (the last entry: or more): robots and the time at which each is due."""
        self._level: dict[str, int] = {}
        self._open: dict[str, int] = {}
        self._repeated = 0
        self._newest = False
        self._next_repeat_s = float("-inf")

    def __len__(self) -> int:
        return len(self._level)

    def __contains__(self, robot: str) -> bool:
        return robot in self._level

    def add(self, robot: str, now_s: float, asked: int = 0) -> None:
        """Have a robot asked, as if it had been asked ``asked`` times. A robot in the queue keeps its place."""
        if robot not in self._level:
            self._put(robot, asked, now_s)

    def discard(self, robot: str) -> int:
        """Have a robot asked no more. Return how often it was asked."""
        level = self._level.pop(robot, None)
        if level is not None:
            self._waiting[level].pop(robot, None)
        return level or 0

    def take(self, now_s: float) -> str | None:
        """The robot to ask now, if there is one and the bounds allow it. ``finished`` or ``failed`` has to follow."""
        if len(self._open) >= self._bounds.open:
            return None
        for level, waiting in enumerate(self._waiting):
            if level and (self._repeated >= self._bounds.repeated or now_s < self._next_repeat_s):
                return None
            # All of a level wait equally long, so the first is due first. One that is still being asked has to wait.
            in_order = reversed(waiting) if self._newest and not level else iter(waiting)
            robot = next((each for each in in_order if each not in self._open), None)
            if robot is None or waiting[robot] > now_s:
                continue
            del waiting[robot]
            self._open[robot] = level
            if level:
                self._repeated += 1
                self._next_repeat_s = now_s + 1 / self._bounds.repeats_hz
            else:
                self._newest = not self._newest
            return robot
        return None

    def failed(self, robot: str, now_s: float) -> int:
        """The robot has to be asked again. Return how often it was asked, 0 if it was discarded meanwhile."""
        asked = self._close(robot) + 1
        if robot not in self._level or robot in self._waiting[self._level[robot]]:
            return 0  # it was discarded, and perhaps added anew
        self._put(robot, asked, now_s)
        return asked

    def finished(self, robot: str) -> None:
        """The robot has not to be asked any more."""
        self._close(robot)
        if robot in self._level and robot not in self._waiting[self._level[robot]]:
            del self._level[robot]

    def victim(self) -> str | None:
        """The robot that has failed to answer most often, and of those the one that is due first."""
        return next((next(iter(waiting)) for waiting in reversed(self._waiting[1:]) if waiting), None)

    def _close(self, robot: str) -> int:
        level = self._open.pop(robot)
        self._repeated -= level > 0
        return level

    def _put(self, robot: str, asked: int, now_s: float) -> None:
        level = self._level[robot] = min(asked, len(BACKOFF_S))
        self._waiting[level][robot] = now_s + BACKOFF_S[level - 1] if level else now_s
