"""The order in which agents are queried for their descriptions. Pure: times in seconds are passed in.

A query to an agent that does not answer lasts until its timeout. To keep thousands of such agents from delaying others,
the number of concurrent queries is bounded, first queries precede repeated ones, fewer repetitions precede more, and
repeated queries have lower bounds of their own in number and rate. Every second first query goes to the robot that came
last, so that one that comes after a flood need not wait for all of it.
"""

from collections import OrderedDict
from dataclasses import dataclass

BACKOFF_S = (0.1, 0.2, 0.5, 1.0, 2.0)
"""Waiting times before the repetitions of a query; the last one applies from then on."""


@dataclass(frozen=True)
class Bounds:
    """Bounds: ``open`` concurrent queries, ``repeated`` of them repetitions, and ``repeats_hz``, their rate."""

    open: int
    repeated: int
    repeats_hz: float


class DescriptionQueue:
    """Robots to query. A robot is waiting, being queried, or not in the queue."""

    def __init__(self, bounds: Bounds) -> None:
        self._bounds = bounds
        self._waiting = [OrderedDict[str, float]() for _ in range(len(BACKOFF_S) + 1)]
        """Robots with their due times, by the number of queries so far (the last entry: or more)."""
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
        """Add a robot as if it had been queried ``asked`` times. A robot in the queue keeps its place."""
        if robot not in self._level:
            self._put(robot, asked, now_s)

    def discard(self, robot: str) -> int:
        """Remove a robot. Return how often it was queried."""
        level = self._level.pop(robot, None)
        if level is not None:
            self._waiting[level].pop(robot, None)
        return level or 0

    def take(self, now_s: float) -> str | None:
        """Return the robot to query now, or None if none is due or the bounds are reached.

        Then call ``finished`` or ``failed``.
        """
        if len(self._open) >= self._bounds.open:
            return None
        for level, waiting in enumerate(self._waiting):
            if level and (self._repeated >= self._bounds.repeated or now_s < self._next_repeat_s):
                return None
            # All robots of a level wait equally long, so the first is due first. One with a running query is skipped.
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
        """Queue the robot again after a failed query.

        Return the number of queries so far, 0 if it was discarded meanwhile.
        """
        asked = self._close(robot) + 1
        if robot not in self._level or robot in self._waiting[self._level[robot]]:
            return 0  # discarded, and perhaps added again
        self._put(robot, asked, now_s)
        return asked

    def finished(self, robot: str) -> None:
        """Remove the robot after a successful query."""
        self._close(robot)
        if robot in self._level and robot not in self._waiting[self._level[robot]]:
            del self._level[robot]

    def victim(self) -> str | None:
        """Return the robot with the most failed queries; among equals, the one that is due first."""
        return next((next(iter(waiting)) for waiting in reversed(self._waiting[1:]) if waiting), None)

    def _close(self, robot: str) -> int:
        level = self._open.pop(robot)
        self._repeated -= level > 0
        return level

    def _put(self, robot: str, asked: int, now_s: float) -> None:
        level = self._level[robot] = min(asked, len(BACKOFF_S))
        self._waiting[level][robot] = now_s + BACKOFF_S[level - 1] if level else now_s
