"""Demonstrations of one robot: they are told of when they end, and begin anew only when a person says so."""

import logging
import os

from linked_fleet_agent.motion import Motions

_log = logging.getLogger(__name__)


class Demonstration:
    """The joints of ``motions`` that go to and fro until a stop or a command takes them."""

    def __init__(self, robot: str, motions: Motions) -> None:
        self._robot, self._motions = robot, motions
        self._swaying = motions.swaying

    def note(self) -> None:
        """Say which demonstrations have ended since the last call, and how a person begins them anew."""
        ended, self._swaying = self._swaying - self._motions.swaying, self._motions.swaying
        if ended:
            joints, process = ", ".join(sorted(ended)), os.getpid()
            _log.warning(
                "%s: the demonstration of %s has ended; to begin it anew: kill -USR1 %d", self._robot, joints, process
            )

    def begin_anew(self) -> None:
        """Begin what has ended, on joints that stand. To be called because a person asks for it, and for nothing else.

        A program that undid a stop would move a robot that somebody has just stopped.
        """
        begun = self._motions.sway_anew()
        self._swaying = self._motions.swaying
        if begun:
            _log.warning("%s: the demonstration of %s begins anew", self._robot, ", ".join(begun))
        else:
            _log.info("%s: there is no demonstration that could begin anew now", self._robot)
