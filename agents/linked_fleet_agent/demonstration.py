"""Demonstrations of one robot. Their end is logged, and only a person can restart them."""

import logging
import os

from linked_fleet_agent.motion import Motions

_log = logging.getLogger(__name__)


class Demonstration:
    """The joints of ``motions`` that swing until a stop or a command takes them over."""

    def __init__(self, robot: str, motions: Motions) -> None:
        self._robot, self._motions = robot, motions
        self._swaying = motions.swaying

    def log_ended(self) -> None:
        """Log the demonstrations that have ended since the last call, and how to restart them."""
        ended, self._swaying = self._swaying - self._motions.swaying, self._motions.swaying
        if ended:
            joints, process = ", ".join(sorted(ended)), os.getpid()
            _log.warning(
                "%s: the demonstration of %s has ended; to restart it: kill -USR1 %d", self._robot, joints, process
            )

    def restart(self) -> None:
        """Restart the ended demonstrations of idle joints. Call it only because a person asks for it.

        A program that undid a stop would move a robot that somebody has just stopped.
        """
        begun = self._motions.restart_demonstrations()
        self._swaying = self._motions.swaying
        if begun:
            _log.warning("%s: the demonstration of %s restarts", self._robot, ", ".join(begun))
        else:
            _log.info("%s: no demonstration can be restarted now", self._robot)
