"""Contents of long replies, sent in the parts that a gateway asks for.

A long reply in one message would occupy a slow link for its whole length. Zenoh closes a session whose message waits
for five seconds, and all robots of the agent would vanish.
"""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import NamedTuple

from linked_fleet_agent.wire.parts import PartHead, PartRequest, content_tag

MAX_HELD_BYTES = 64 * 2**20
HELD_S = 30.0
"""Time without a request after which a content is forgotten."""


class PartError(Exception):
    """A part that is not available; the message gives the reason."""


class _Held(NamedTuple):
    content: bytes
    used_s: float


def part_of(content: bytes, tag: str, asked: PartRequest) -> tuple[bytes, PartHead]:
    """Return a part of a content and its head. Raises PartError if the request is about another content."""
    if (asked.tag and asked.tag != tag) or asked.start > len(content):
        raise PartError(f"there is no content {asked.tag!r} with a byte {asked.start}; ask for its first part again")
    return content[asked.start : asked.start + asked.length], PartHead(tag, len(content))


class LongReplies:
    """Contents under way, by query and tag, within MAX_HELD_BYTES. Its methods may be called from any thread."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._held: OrderedDict[tuple[bytes, str], _Held] = OrderedDict()

    @property
    def held_bytes(self) -> int:
        return sum(len(each.content) for each in self._held.values())

    def part(self, query: bytes, asked: PartRequest, read: Callable[[bytes], bytes]) -> tuple[bytes, PartHead]:
        """Return a part and its head. ``read`` gives the content, also of a later part that is no longer held.

        Raises PartError, and what ``read`` raises.
        """
        held = self._held.get((query, asked.tag))
        content = read(query) if held is None else held.content
        tag = content_tag(content) if held is None else asked.tag
        part, head = part_of(content, tag, asked)
        self._hold(query, tag, content, is_over=asked.start + len(part) == len(content))
        return part, head

    def forget_idle(self) -> None:
        """Forget the contents that nobody has asked for in HELD_S."""
        oldest_s = self._clock() - HELD_S
        with self._lock:
            for key in [key for key, held in self._held.items() if held.used_s <= oldest_s]:
                del self._held[key]

    def _hold(self, query: bytes, tag: str, content: bytes, is_over: bool) -> None:
        with self._lock:
            self._held.pop((query, tag), None)
            if not is_over:
                self._held[query, tag] = _Held(content, self._clock())
            while len(self._held) > 1 and self.held_bytes > MAX_HELD_BYTES:
                self._held.popitem(last=False)
