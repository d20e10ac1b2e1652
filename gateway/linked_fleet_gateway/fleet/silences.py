"""Runs of agents that have a presence token and send no frames. Pure: times in seconds are handed in.

A token is no proof (Zenoh 1.10). In a mesh of routers, one that goes while a connection breaks may stay for ever, and
the event loop of an agent may hang while Zenoh's threads keep its token. Nor is silence: routers may have lost the
gateway's subscription to frames (``agents/linked_fleet_agent/renewal.py``). So the agent is asked.
"""

from collections.abc import Iterable
from typing import NamedTuple

from linked_fleet_gateway.fleet.presence import Token

SILENT_S = 5.0
"""A run without a frame for so long is asked whether it is there, then after waiting times that double."""
RENEWALS = 3
"""So often in one silence does the gateway declare itself anew for a robot that answers."""
PERIOD_S = 1.0
_LONGEST_S = 60.0


class Run(NamedTuple):
    """A run that is online and described, and the number of its last frame; -1 before the first."""

    robot: str
    incarnation: int
    sequence: int


class Doubt(NamedTuple):
    """A run of which no frame comes. ``renew``: if it answers, the gateway has to declare itself anew."""

    token: Token
    renew: bool


class _Silence(NamedTuple):
    run: Run
    due_s: float
    asked: int = 0


class Silences:
    """Runs of which no frame comes. Time in which nobody called ``check`` does not count."""

    def __init__(self) -> None:
        self._silences: dict[str, _Silence] = {}
        self._checked_s: float | None = None
        self._ran_s = 0.0

    def check(self, now_s: float, runs: Iterable[Run]) -> list[Doubt]:
        """Return those of ``runs``, which are all that are online, who have to be asked now; does nothing if called
        again within ``PERIOD_S``."""
        gap_s = PERIOD_S if self._checked_s is None else now_s - self._checked_s
        if gap_s < PERIOD_S:
            return []
        self._checked_s = now_s
        self._ran_s += min(gap_s, 2 * PERIOD_S)  # what was sent while the gateway was paused is yet to be read
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
