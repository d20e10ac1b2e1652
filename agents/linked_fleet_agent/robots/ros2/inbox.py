"""Messages of one topic, decoded when they are looked at."""

import logging
import math
from collections.abc import Iterator
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.graph import Graph, Interface
from linked_fleet_agent.robots.ros2.serialization import CdrError

_log = logging.getLogger(__name__)

LONGEST_BYTES = 65_536
MOST_BYTES_S, BURST_BYTES = 524_288, 262_144
"""Bytes of one topic that are decoded in a second, and at once: a flood costs its topic, and not the robot."""
M = TypeVar("M")
M_co = TypeVar("M_co", covariant=True)


class Reader(Protocol[M_co]):
    """A type of messages, and how its messages are read."""

    @property
    def name(self) -> str: ...

    def read(self, payload: bytes, most_bytes: int) -> M_co:
        """Return a message. Raises CdrError, and DefinitionError for a type that cannot be used."""


class TypedInbox(Generic[M]):
    """The messages of a topic. One that cannot be read is counted and logged: the 1st, 2nd, 4th and so on.

    ``value`` is the last one that could be read, and ``at_s`` its arrival in monotonic seconds.
    """

    def __init__(
        self,
        graph: Graph,
        topic: str,
        type: Reader[M],
        *,
        latched: bool = False,
        longest: int = LONGEST_BYTES,
        most: int = 32,
        most_bytes_s: float = MOST_BYTES_S,
    ) -> None:
        self.topic, self._type, self._longest = topic, type, longest
        self._box = graph.subscribe(Interface(topic, type.name), longest, most, latched)
        self.value: M | None = None
        self.bad_messages, self.at_s = 0, -math.inf
        self._most_bytes_s, self._room, self._spent_s = most_bytes_s, float(BURST_BYTES), -math.inf

    def fetch(self) -> list[M]:
        """Return the messages since the last call, oldest first."""
        return [said for said, _ in self.arrivals()]

    def arrivals(self) -> Iterator[tuple[M, float]]:
        """Yield the messages since the last call with the times of their arrival, oldest first."""
        for payload, at_s in self._box.fetch():
            if (said := self._read(payload, at_s)) is not None:
                yield said, at_s

    def newest(self) -> M | None:
        """Return the last message, None if none has come. Those that it has replaced are not decoded."""
        arrived = self._box.fetch()
        while arrived and self._read(*arrived.pop()) is None:
            pass
        return self.value

    def is_fresh(self, now_s: float, stale_s: float) -> bool:
        """Return True if the last message came within ``stale_s`` seconds; ``now_s`` is monotonic."""
        return now_s - self.at_s <= stale_s

    def _read(self, payload: bytes | None, at_s: float) -> M | None:
        try:
            if payload is None:
                raise CdrError(f"it has more than {self._longest} bytes")
            self._spend(len(payload), at_s)
            self.value, self.at_s = self._type.read(payload, self._longest), at_s
        except (CdrError, DefinitionError) as error:
            self.bad_messages += 1
            if self.bad_messages.bit_count() == 1:
                _log.warning("%s: a message cannot be read (%d so far): %.200s", self.topic, self.bad_messages, error)
            return None
        return self.value

    def _spend(self, size: int, at_s: float) -> None:
        """Take room for decoding so many bytes that arrived at ``at_s``. Raises CdrError if there is none."""
        elapsed_s = min(max(at_s - self._spent_s, 0.0), 3600.0)
        self._room = min(self._room + elapsed_s * self._most_bytes_s, BURST_BYTES)
        self._spent_s = max(at_s, self._spent_s)
        if self._room < size:
            raise CdrError(f"more than {self._most_bytes_s:g} bytes a second come on this topic")
        self._room -= size


Inbox: TypeAlias = TypedInbox[dict[str, Any]]
"""The messages of a topic as dicts by field."""
