"""Messages, outlets, and the loop that sends the same bytes to many subscribers.

A message is rendered once, framed once per channel, and shared by all. One loop serves all subscribers of a resource
that have received the same messages so far.
"""

import logging
import time
from collections.abc import Callable, Iterable
from enum import Enum
from itertools import compress
from operator import not_
from typing import Generic, Protocol, TypeVar, runtime_checkable

from msgspec import Struct, field

from linked_fleet_gateway.resources.versioning import Reading
from linked_fleet_rdf.serialise import WriteError

_log = logging.getLogger(__name__)


class Message(Struct):
    """A complete representation of one resource at one version; never modified.

    One is created for each change of each watched value: a Struct costs a fifth of a frozen dataclass.
    """

    path: str
    version: str
    media_type: str
    body: bytes
    event_id: str
    """Id of the message, from which a stream resumes (``event_id.py``)."""
    _frames: dict["Framing", bytes] = field(default_factory=dict)

    def frame_with(self, framing: "Framing") -> bytes:
        """Return the bytes that ``framing`` makes of this message, made once for all recipients."""
        frame = self._frames.get(framing)
        if frame is None:
            frame = self._frames[framing] = framing(self)
        return frame


Framing = Callable[[Message], bytes]


class Ending(Enum):
    """The reason why no more messages will come."""

    CANCELLED = "the subscription was deleted"
    GONE = "the resource does not exist any more"
    FINAL = "the resource will not change any more"
    UNENTITLED = "the right to subscribe has ended"
    REPLACED = "the subscription was opened on another connection"
    SHUTDOWN = "the gateway is shutting down"


class Outlet(Protocol):
    """The last step of a channel. It never blocks and buffers a bounded number of bytes."""

    def writable(self) -> bool:
        """Return True if a message would leave almost at once; otherwise values are conflated."""

    def write(self, message: Message) -> None:
        """Send one message. Called only while ``writable()``; a message of any size is accepted whole."""

    def end(self, ending: Ending) -> None:
        """Close the channel; nothing is written after it."""


@runtime_checkable
class Stream(Outlet, Protocol):
    """An outlet that also accepts framed bytes, which are the same for all streams of its kind."""

    framing: Framing

    def send(self, frame: bytes) -> bool:
        """Send bytes made by ``framing`` if the stream is ``writable()``; return whether they were sent."""


class Feed(Protocol):
    """The interface of the fan-out to an outlet."""

    def schedule_send(self) -> None:
        """Announce that the outlet can take messages, at first and whenever it has become writable again."""


_SHARE = 32  # members served before the clock is read again
_Send = Callable[[bytes], bool]


class Member(Protocol):
    """The interface of a subscriber to a broadcast."""

    def leave_broadcast(self, path: str, sent: Reading) -> None:
        """Leave the broadcast, because the outlet had no room for a message; ``sent``: the reading sent before."""

    def join_broadcast(self, path: str) -> None:
        """Join a broadcast of the resource, if this subscriber has caught up with it."""


M = TypeVar("M", bound=Member)


class WatchedResource(Protocol):
    """The interface of a watched resource to a broadcast."""

    path: str
    reading: Reading

    def differs(self, sent: Reading | None) -> bool: ...

    def message(self, media_type: str, base: str) -> Message:
        """Return the message about the present reading; WriteError if the syntax cannot express it."""

    def join_broadcasts(self) -> None:
        """Let subscribers that have caught up join a broadcast."""


class SendCounter(Protocol):
    """The interface of the fan-out to whatever sends messages."""

    messages_sent: int
    """Messages handed to subscribers so far."""


class Broadcast(Generic[M]):
    """Subscribers that were all sent the same reading last and have nothing pending.

    A pass brings one message to everybody who was a member when it began. News during a pass waits for the next pass,
    which sends the latest reading. A member without room for a message leaves the broadcast, and its watcher serves it
    alone until it has caught up.
    """

    def __init__(
        self,
        fan_out: SendCounter,
        topic: WatchedResource,
        media_type: str,
        base: str,
        framing: Framing,
        refresh: Callable[[], None],
    ) -> None:
        """``refresh`` reads the resource again if it is marked as changed."""
        self.scheduled = False
        self.last_sent_ns: int | None = None
        """Wall-clock time at which the last pass ended."""
        self._fan_out, self._topic, self._refresh = fan_out, topic, refresh
        self._media_type, self._base, self._framing = media_type, base, framing
        self.members: dict[M, _Send] = {}
        # The reading sent last. During a pass: to the members already served, and the one before it to the others.
        self._reading = self._before = topic.reading
        self._pass: list[M] = []
        self._sends: list[_Send] = []
        self._served = 0
        self._frame = b""
        self._news = False

    def admit_member(self, watcher: M, send: _Send, reading: Reading) -> bool:
        """Admit a watcher that was last sent ``reading``, if the members have that reading or get it in this pass."""
        if not self.members:
            self._reading, self._pass = reading, []
        if reading is not self._reading:
            return False
        self.members[watcher] = send
        return True

    def remove_member(self, watcher: M) -> None:
        del self.members[watcher]

    def release_member(self, watcher: M) -> Reading:
        """Remove a member whose outlet stays open, and return the reading it was sent.

        It gets nothing more of this pass.
        """
        del self.members[watcher]
        if watcher not in self._pass[self._served :]:
            return self._reading
        place = self._pass.index(watcher, self._served)
        del self._pass[place], self._sends[place]
        return self._before

    def mark_changed(self) -> int:
        """Note news; return how many members will never be sent the news before it."""
        replaced = len(self.members) if self._news else 0
        self._news = True
        return replaced

    def prepare(self) -> bool:
        """Prepare a message; return True if there is one that has not been sent to everybody."""
        if self._pass:
            return True
        self._refresh()
        self._news = False
        if not self.members or not self._topic.differs(self._reading):  # it may have returned to the old value
            return False
        try:
            message = self._topic.message(self._media_type, self._base)
        except WriteError as error:
            _log.warning("%d subscriptions of %s get no message: %s", len(self.members), self._topic.path, error)
            return False
        self._frame = message.frame_with(self._framing)
        self._before, self._reading = self._reading, self._topic.reading
        self._pass, self._sends, self._served = list(self.members), list(self.members.values()), 0
        return True

    def step(self) -> bool:
        """Send the prepared message to some members; return True if there is more to do."""
        frame, first = self._frame, self._served
        sent = [send(frame) for send in self._sends[first : first + _SHARE]]
        self._served += len(sent)
        count = sum(sent)
        self._fan_out.messages_sent += count
        if count < len(sent):
            self._dismiss_full(compress(self._pass[first:], map(not_, sent)))
        if self._served < len(self._pass):
            return True
        self._pass, self._sends = [], []
        self.last_sent_ns = time.time_ns()
        self._topic.join_broadcasts()
        return self._news

    def _dismiss_full(self, full: Iterable[M]) -> None:
        for watcher in full:
            if watcher in self.members:  # it may have left since the pass began
                watcher.leave_broadcast(self._topic.path, self._before)
