"""Subscribers of one resource that are in step: the same bytes go to all of them, in one straight loop."""

import logging
from collections.abc import Callable, Iterable
from itertools import compress
from operator import not_
from typing import Generic, Protocol, TypeVar

from linked_fleet_gateway.rdf.serialise import WriteError
from linked_fleet_gateway.resources.versioning import Reading
from linked_fleet_gateway.subscriptions.message import Framing, Message

_log = logging.getLogger(__name__)
_SHARE = 32  # members served between two looks at the clock
_Send = Callable[[bytes], bool]


class Member(Protocol):
    """A subscriber, as those need it who serve several."""

    def fall_behind(self, path: str, sent: Reading) -> None:
        """There was no room for the message that the others have got; ``sent`` is what was sent before."""

    def fall_in(self, path: str) -> None:
        """Join a broadcast of the resource, if this one has caught up with it."""


M = TypeVar("M", bound=Member)


class Watched(Protocol):
    """A watched resource, as a broadcast needs it."""

    path: str
    reading: Reading

    def differs(self, sent: Reading | None) -> bool: ...

    def gather(self) -> None:
        """Have those fall in that have caught up with a broadcast."""


class Sending(Protocol):
    """The fan-out, as those need it who send messages."""

    messages: int
    """How many have been handed to a subscriber."""

    def wall_ns(self) -> int: ...


class Broadcast(Generic[M]):
    """Every member has been sent the same message last, and nothing waits for it.

    A pass brings one message to all who were members when it began. News that comes meanwhile is for the next pass,
    which brings the latest. Who has no room for a message falls out of step: until it has caught up, its watcher sees
    to it alone.
    """

    def __init__(
        self,
        fan_out: Sending,
        topic: Watched,
        framing: Framing,
        freshen: Callable[[], None],
        message: Callable[[], Message],
    ) -> None:
        """``freshen`` reads the resource, if something has happened to it since; ``message`` gives the message about
        the present reading, or raises WriteError."""
        self.running = False
        self.last_ns: int | None = None
        """When the last pass was over."""
        self._fan_out, self._topic, self._framing = fan_out, topic, framing
        self._freshen, self._message = freshen, message
        self.members: dict[M, _Send] = {}
        # What members have been sent; in a pass those that have been served, and the others what was before.
        self._reading = self._before = topic.reading
        self._pass: list[M] = []
        self._sends: list[_Send] = []
        self._served = 0
        self._frame = b""
        self._news = False

    def admit(self, watcher: M, send: _Send, reading: Reading) -> bool:
        """Take in who has been sent ``reading``, if that is what the others have, or get in this pass."""
        if not self.members:
            self._reading, self._pass = reading, []
        if reading is not self._reading:
            return False
        self.members[watcher] = send
        return True

    def dismiss(self, watcher: M) -> None:
        del self.members[watcher]

    def release(self, watcher: M) -> Reading:
        """``dismiss`` a member whose outlet stays open; what it has been sent. It gets no more of this pass."""
        del self.members[watcher]
        if watcher not in self._pass[self._served :]:
            return self._reading
        place = self._pass.index(watcher, self._served)
        del self._pass[place], self._sends[place]
        return self._before

    def tell(self) -> int:
        """There is news; how many will not be sent what was news before."""
        replaced = len(self.members) if self._news else 0
        self._news = True
        return replaced

    def prepare(self) -> bool:
        """Have a message ready; whether there is one that has not been sent to all."""
        return bool(self._pass) or self._begin()

    def step(self) -> bool:
        """Send what is ready to some members; whether there is more to do."""
        frame, first = self._frame, self._served
        sent = [send(frame) for send in self._sends[first : first + _SHARE]]
        self._served += len(sent)
        count = sum(sent)
        self._fan_out.messages += count
        if count < len(sent):
            self._leave_behind(compress(self._pass[first:], map(not_, sent)))
        if self._served < len(self._pass):
            return True
        self._pass, self._sends = [], []
        self.last_ns = self._fan_out.wall_ns()
        self._topic.gather()
        return self._news

    def _leave_behind(self, full: Iterable[M]) -> None:
        for watcher in full:
            if watcher in self.members:  # it can have left since the pass began
                watcher.fall_behind(self._topic.path, self._before)

    def _begin(self) -> bool:
        self._freshen()
        self._news = False
        if not self.members or not self._topic.differs(self._reading):  # it may have moved back since
            return False
        try:
            message = self._message()
        except WriteError as error:
            _log.warning("%d subscriptions of %s get no message: %s", len(self.members), self._topic.path, error)
            return False
        self._frame = message.framed(self._framing)
        self._before, self._reading = self._reading, self._topic.reading
        self._pass, self._sends, self._served = list(self.members), list(self.members.values()), 0
        return True
