"""Descriptions that a robot sends while it runs. They are judged in a thread, one at a time: the robot goes on."""

import logging
import math
import threading
import time
from collections.abc import Sequence

from linked_fleet_agent.robot import Facts, NewDescriptionError, RobotFaultError
from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.finding import facts_of
from linked_fleet_agent.robots.ros2.graph import Mailbox, ReceivedMessage
from linked_fleet_agent.urdf import UrdfError

_log = logging.getLogger(__name__)

_REST = 50.0
"""After a description was judged, the next one waits for so many times as long: a flood costs 2 % of the time."""
_CDR_ROOM = 16
"""More bytes than CDR needs around the text of a std_msgs/String: head, length, zero byte and padding."""


class NewDescriptions:
    """The descriptions that came on their topic since the robot was found with its ``own`` one."""

    def __init__(self, name: str, own: Facts, box: Mailbox) -> None:
        self._name, self._own, self._box = name, own, box
        self._own_text = own.urdf.encode()
        self._refused, self._look_again_s = "", -math.inf
        self._judgement: _Judgement | None = None
        self.bad_messages = 0
        """Messages that are no descriptions."""

    def check(self) -> None:
        """Look at what has come.

        Raises NewDescriptionError for a good one that is another, RobotFaultError while the last one is refused.
        """
        if self._judgement is not None and not self._judgement.is_alive():
            ended, self._judgement = self._judgement, None
            self._take(ended)
        newest = self._box.newest
        if newest is not None and self._is_own(newest.payload):
            self._box.fetch()
            self._refused = ""
            if self._judgement is not None:
                self._judgement.replaced = True
        elif newest is not None and self._judgement is None and time.monotonic() >= self._look_again_s:
            self._judgement = _Judgement(self._name, self._own.urdf, self._box.fetch())
            self._judgement.start()
        if self._refused:
            raise RobotFaultError(self._refused)

    def _take(self, ended: "_Judgement") -> None:
        self._look_again_s = time.monotonic() + _REST * ended.took_s
        for bad in ended.bad:
            self.bad_messages += 1
            if self.bad_messages.bit_count() == 1:
                _log.warning("%s: a message that is no description is ignored: %s", self._name, bad)
        if ended.replaced or ended.refused is None:
            return
        if ended.is_another:
            raise NewDescriptionError("the robot sent a new description")
        self._refused = ended.refused

    def _is_own(self, payload: bytes | None) -> bool:
        """Return whether this message has the text of this robot's description, which costs next to nothing."""
        room = 0 if payload is None else len(payload) - len(self._own_text)
        return payload is not None and 0 < room < _CDR_ROOM and self._own_text in payload


class _Judgement(threading.Thread):
    """Judges the newest message that is a description at all.

    ``refused`` is a sentence, empty for a good description, and None if there is none among the messages. ``bad`` says
    of others why they are none. The robot's own one has ``replaced`` it if that came meanwhile.
    """

    def __init__(self, name: str, own: str, messages: Sequence[ReceivedMessage]) -> None:
        super().__init__(name=f"description of {name}", daemon=True)
        self._robot, self._own, self._messages = name, own, messages
        self.refused: str | None = None
        self.is_another = self.replaced = False
        self.bad = list[str]()
        self.took_s = 0.0

    def run(self) -> None:
        begun_s = time.monotonic()
        for each in reversed(self._messages):
            try:
                self.is_another = each.payload is None or cdr.read_string(each.payload) != self._own
                if self.is_another:
                    facts_of(self._robot, each)
                self.refused = ""
            except cdr.CdrError as error:
                self.bad.append(str(error))
                continue
            except UrdfError as error:
                self.is_another, self.refused = False, f"the robot sent a new description, which is refused: {error}"
            break
        self.took_s = time.monotonic() - begun_s
