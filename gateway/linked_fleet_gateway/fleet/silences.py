"""Agents with a presence token that send no frames. Pure: times in seconds are passed in.

A token proves nothing (Zenoh 1.10): in a mesh of routers, a token that goes while a connection breaks may stay for
ever, and Zenoh's threads keep the token of an agent whose event loop hangs. Silence proves nothing either: routers may
have lost the gateway's subscription to frames (``agents/linked_fleet_agent/renewal.py``). So the agent is queried.
"""

from collections.abc import Iterable
from typing import NamedTuple

from linked_fleet_gateway.fleet.presence import Token

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
