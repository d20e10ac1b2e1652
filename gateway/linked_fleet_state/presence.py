"""Presence of agents: liveliness tokens, runs that send no frames, and the order of queries for descriptions.

Pure: times in seconds are passed in.

A peer can invent robots by declaring tokens, so the table bounds the runs of one robot and the number of robots without
a description. Tokens beyond the bounds are not kept, and ``incomplete`` is set.

A token proves nothing (Zenoh 1.10): in a mesh of routers, a token that goes while a connection breaks may stay for
ever, and Zenoh's threads keep the token of an agent whose event loop hangs. Silence proves nothing either: routers may
have lost the gateway's subscription to frames (``agents/linked_fleet_agent/gateways.py``). So the agent is queried.

A query to an agent that does not answer lasts until its timeout. To keep thousands of such agents from delaying others,
the number of concurrent queries is bounded, first queries precede repeated ones, fewer repetitions precede more, and
repeated queries have lower bounds of their own in number and rate. Every second first query goes to the robot that came
last, so that one that comes after a flood need not wait for all of it.

Prompt replies raise the number of concurrent queries, slow ones halve it. Replies have some 10 kB each, and those that
wait at a congested router delay everything behind them.
"""

from collections import OrderedDict
from dataclasses import dataclass
from typing import NamedTuple

MAX_RUNS = 8
"""Most runs of one robot at once. The highest are kept, because the highest is the present one."""
MAX_UNDESCRIBED = 10_000
"""Most robots without a description: as many as a fleet that joins at one moment."""

Token = tuple[str, int]
"""Robot and run."""


class Presence:
    """The present tokens. Not thread-safe."""

    def __init__(self) -> None:
        self._runs: dict[str, set[int]] = {}
        self._undescribed: dict[str, None] = {}
        self.incomplete = False
        """True if a present token was refused or forgotten. The owner then lists all tokens to find it."""

    def __contains__(self, token: Token) -> bool:
        return token[1] in self._runs.get(token[0], ())

    @property
    def tokens(self) -> set[Token]:
        return {(robot, run) for robot, runs in self._runs.items() for run in runs}

    @property
    def undescribed_count(self) -> int:
        """The number of robots without a description."""
        return len(self._undescribed)

    @property
    def is_full(self) -> bool:
        """True if there is no room for another robot without a description."""
        return len(self._undescribed) >= MAX_UNDESCRIBED

    def runs(self, robot: str) -> frozenset[int]:
        return frozenset(self._runs.get(robot, ()))

    def add(self, token: Token, described: bool = False) -> Token | None:
        """Add a token. Return the one removed for it: the lowest run of that robot, or ``token`` itself.

        ``described`` says that the robot has described itself before. Raises OverflowError if there is no room for the
        robot.
        """
        robot, run = token
        runs = self._runs.get(robot)
        if runs is None:
            if not described and self.is_full:
                self.incomplete = True
                raise OverflowError(f"more than {MAX_UNDESCRIBED} robots have a token and no description")
            self._runs[robot] = {run}
            if not described:
                self._undescribed[robot] = None
            return None
        runs.add(run)
        if len(runs) <= MAX_RUNS:
            return None
        self.incomplete = True
        lowest = min(runs)
        runs.remove(lowest)
        return robot, lowest

    def remove(self, token: Token) -> None:
        robot, run = token
        runs = self._runs.get(robot, set())
        runs.discard(run)
        if not runs:
            self._runs.pop(robot, None)
            self._undescribed.pop(robot, None)

    def describe(self, robot: str) -> None:
        """Record that the robot has described itself."""
        self._undescribed.pop(robot, None)

    def forget(self, robot: str) -> frozenset[int]:
        """Drop the tokens of a robot although they are present. Return their runs."""
        self.incomplete = True
        self._undescribed.pop(robot, None)
        return frozenset(self._runs.pop(robot, ()))


SILENT_S = 5.0
"""Time without a frame after which a run is queried; further queries follow after doubling delays."""
RENEWALS = 3
"""Number of times in one silence that the gateway renews its declarations because of a robot that answers."""
PERIOD_S = 1.0
_LONGEST_S = 60.0


class Run(NamedTuple):
    """A run that is online and described, and the number of its last frame; -1 before the first."""

    robot: str
    incarnation: int
    sequence: int


class PresenceCheck(NamedTuple):
    """A run that sends no frames. If ``renew`` is set and it answers, the gateway must renew its declarations."""

    token: Token
    renew: bool


class _Silence(NamedTuple):
    run: Run
    due_s: float
    asked: int = 0


class SilentRuns:
    """Runs that send no frames, found in rounds. Time without rounds does not count."""

    def __init__(self) -> None:
        self._silences: dict[str, _Silence] = {}
        self._before: dict[str, _Silence] = {}
        self._checked_s: float | None = None
        self._ran_s = 0.0

    def begin_round(self, now_s: float) -> bool:
        """Return True if ``check`` is now to be called with every run that is online; False within ``PERIOD_S``."""
        gap_s = PERIOD_S if self._checked_s is None else now_s - self._checked_s
        if gap_s < PERIOD_S:
            return False
        self._checked_s = now_s
        self._ran_s += min(gap_s, 2 * PERIOD_S)  # messages sent while the gateway was paused are still to be read
        self._before, self._silences = self._silences, {}
        return True

    def check(self, run: Run) -> PresenceCheck | None:
        """Return the query that is due for a run, if any."""
        silence, check = self._before.get(run.robot), None
        if silence is None or silence.run != run:
            silence = _Silence(run, self._ran_s + SILENT_S)
        elif self._ran_s >= silence.due_s:
            asked = silence.asked + 1
            check = PresenceCheck((run.robot, run.incarnation), asked <= RENEWALS)
            wait_s = min(SILENT_S * 2 ** min(asked, 8), _LONGEST_S)
            silence = _Silence(run, self._ran_s + wait_s, asked)
        self._silences[run.robot] = silence
        return check


BACKOFF_S = (0.1, 0.2, 0.5, 1.0, 2.0)
"""Waiting times before the repetitions of a query; the last one applies from then on."""
FIRST_OPEN = 16
"""Concurrent queries before the first reply; slow replies bring their number back to this."""
PROMPT_S, SLOW_S = 0.2, 0.5
"""A reply is prompt up to the first time after its query, and slow beyond the second."""


@dataclass(frozen=True)
class Bounds:
    """Bounds: ``open`` concurrent queries at most, ``repeated`` of them repetitions, and ``repeats_hz``, their rate."""

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
        self._room = min(FIRST_OPEN, bounds.open)
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

        Then call ``complete`` or ``requeue``.
        """
        if len(self._open) >= self._room:
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

    def requeue(self, robot: str, now_s: float) -> int:
        """Queue the robot again after a failed query.

        Return the number of queries so far, 0 if it was discarded meanwhile.
        """
        asked = self._close(robot) + 1
        if robot not in self._level or robot in self._waiting[self._level[robot]]:
            return 0  # discarded, and perhaps added again
        self._put(robot, asked, now_s)
        return asked

    def complete(self, robot: str, took_s: float) -> None:
        """Remove the robot after a successful query, whose reply took so long."""
        self._close(robot)
        if took_s <= PROMPT_S:
            self._room = min(self._room + 1, self._bounds.open)
        elif took_s > SLOW_S:
            self._room = max(self._room // 2, min(FIRST_OPEN, self._bounds.open))
        if robot in self._level and robot not in self._waiting[self._level[robot]]:
            del self._level[robot]

    def most_failed(self) -> str | None:
        """Return the robot with the most failed queries; among equals, the one that is due first."""
        return next((next(iter(waiting)) for waiting in reversed(self._waiting[1:]) if waiting), None)

    def _close(self, robot: str) -> int:
        level = self._open.pop(robot)
        self._repeated -= level > 0
        return level

    def _put(self, robot: str, asked: int, now_s: float) -> None:
        level = self._level[robot] = min(asked, len(BACKOFF_S))
        self._waiting[level][robot] = now_s + BACKOFF_S[level - 1] if level else now_s
