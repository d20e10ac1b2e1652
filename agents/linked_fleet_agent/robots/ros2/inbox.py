"""Messages of one topic, decoded when they are looked at."""

import logging
import math
import time
from typing import Any

from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.graph import Graph, Interface
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import MessageType

_log = logging.getLogger(__name__)

LONGEST_BYTES = 65_536
MOST_BYTES_S, BURST_BYTES = 524_288, 262_144
"""Bytes of one topic that are decoded in a second, and at once: a flood costs its topic, and not the robot."""


class Inbox:
    """The messages of a topic. One that cannot be read is counted and logged: the 1st, 2nd, 4th and so on."""

    def __init__(
        self,
        graph: Graph,
        topic: str,
        type: MessageType,
        *,
        latched: bool = False,
        longest: int = LONGEST_BYTES,
        most: int = 32,
    ) -> None:
        self.topic, self._type, self._longest = topic, type, longest
        self._box = graph.subscribe(Interface(topic, type.name), longest, most, latched)
        self.bad_messages, self.value, self.at_s = 0, dict[str, Any](), -math.inf
        self._room, self._looked_s = float(BURST_BYTES), -math.inf

    def fetch(self) -> list[dict[str, Any]]:
        """Return the messages since the last call, oldest first."""
        return [said for each in self._box.fetch() if (said := self._read(each.payload, each.at_s)) is not None]

    def newest(self) -> dict[str, Any]:
        """Return the last message, an empty one if none has come. Those that it has replaced are not decoded."""
        arrived = self._box.fetch()
        while arrived and self._read(*arrived.pop()) is None:
            pass
        return self.value

    def is_fresh(self, now_s: float, stale_s: float) -> bool:
        """Return True if the last message came within ``stale_s`` seconds; ``now_s`` is monotonic."""
        return now_s - self.at_s <= stale_s

    def _read(self, payload: bytes | None, at_s: float) -> dict[str, Any] | None:
        try:
            if payload is None:
                raise CdrError(f"it has more than {self._longest} bytes")
            self._spend(len(payload))
            self.value, self.at_s = self._type.read(payload, self._longest), at_s
        except (CdrError, DefinitionError) as error:
            self.bad_messages += 1
            if self.bad_messages.bit_count() == 1:
                _log.warning("%s: a message cannot be read (%d so far): %.200s", self.topic, self.bad_messages, error)
            return None
        return self.value

    def _spend(self, size: int) -> None:
        """Take room for decoding so many bytes. Raises CdrError if there is none."""
        now_s = time.monotonic()
        elapsed_s = min(now_s - self._looked_s, 3600.0)
        self._room, self._looked_s = min(self._room + elapsed_s * MOST_BYTES_S, BURST_BYTES), now_s
        if self._room < size:
            raise CdrError(f"more than {MOST_BYTES_S} bytes a second come on this topic")
        self._room -= size
