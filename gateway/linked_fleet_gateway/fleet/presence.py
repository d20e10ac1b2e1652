"""Liveliness tokens of agents, and runs that have a token and send no frames. Pure; times are handed in.

A peer can invent robots by declaring tokens, so the table bounds the runs of one robot and the number of robots without
a description. Tokens beyond the bounds are not kept, and ``incomplete`` is set.

A token proves nothing (Zenoh 1.10): in a mesh of routers, a token that goes while a connection breaks may stay for
ever, and Zenoh's threads keep the token of an agent whose event loop hangs. Silence proves nothing either: routers may
have lost the gateway's subscription to frames (``agents/linked_fleet_agent/renewal.py``). So the agent is queried.
"""

from collections.abc import Iterable
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
    def undescribed(self) -> int:
        """The number of robots without a description."""
        return len(self._undescribed)

    @property
    def full(self) -> bool:
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
            if not described and self.full:
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
"""How often in one silence the gateway renews its declarations because of a robot that answers."""
PERIOD_S = 1.0
_LONGEST_S = 60.0


class Run(NamedTuple):
    """A run that is online and described, and the number of its last frame; -1 before the first."""

    robot: str
    incarnation: int
    sequence: int


class Doubt(NamedTuple):
    """A run that sends no frames. If ``renew`` is set and it answers, the gateway must renew its declarations."""

    token: Token
    renew: bool


class _Silence(NamedTuple):
    run: Run
    due_s: float
    asked: int = 0


class Silences:
    """Runs that send no frames. Time in which ``check`` was not called does not count."""

    def __init__(self) -> None:
        self._silences: dict[str, _Silence] = {}
        self._checked_s: float | None = None
        self._ran_s = 0.0

    def check(self, now_s: float, runs: Iterable[Run]) -> list[Doubt]:
        """Return those of ``runs`` (all that are online) to query now. Calls within ``PERIOD_S`` do nothing."""
        gap_s = PERIOD_S if self._checked_s is None else now_s - self._checked_s
        if gap_s < PERIOD_S:
            return []
        self._checked_s = now_s
        self._ran_s += min(gap_s, 2 * PERIOD_S)  # messages sent while the gateway was paused are still to be read
        before, doubts = self._silences, list[Doubt]()
        self._silences = {}
        for run in runs:
            silence = before.get(run.robot)
            if silence is None or silence.run != run:
                silence = _Silence(run, self._ran_s + SILENT_S)
            elif self._ran_s >= silence.due_s:
                asked = silence.asked + 1
                doubts.append(Doubt((run.robot, run.incarnation), asked <= RENEWALS))
                wait_s = min(SILENT_S * 2 ** min(asked, 8), _LONGEST_S)
                silence = _Silence(run, self._ran_s + wait_s, asked)
            self._silences[run.robot] = silence
        return doubts
