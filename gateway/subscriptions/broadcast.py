"""Subscribers of one resource that are in step: the same bytes go to all of them, in one straight loop."""

import logging
from collections.abc import Callable, Iterable
from itertools import compress
from operator import not_
from typing import TYPE_CHECKING, Protocol

from gateway.rdf.serialise import WriteError
from gateway.resources.subscription import Subscription
from gateway.resources.versioning import Reading
from gateway.subscriptions.message import Framing, Message

if TYPE_CHECKING:
    from gateway.subscriptions.topic import Topic
    from gateway.subscriptions.watcher import Watcher

_log = logging.getLogger(__name__)
_SHARE = 32  # members served between two looks at the clock
_Send = Callable[[bytes], bool]


class Rendering(Protocol):
    """What sends messages needs this of the fan-out."""

    messages: int
    """How many have been handed to a subscriber."""

    def wall_ns(self) -> int: ...

    def message(self, topic: "Topic", subscription: Subscription) -> Message:
        """The message about the present reading; WriteError when the syntax cannot say it."""

    def freshen(self, topic: "Topic") -> None:
        """Read the resource, if something has happened to it since."""


class Broadcast:
    """Every member has been sent the same message last, and nothing waits for it.

    A pass brings one message to all who were members when it began. News that comes meanwhile is for the next pass,
    which brings the latest. Who has no room for a message falls out of step: until it has caught up, its watcher sees
    to it alone.
    """

    def __init__(self, fan_out: Rendering, topic: "Topic", subscription: Subscription, framing: Framing) -> None:
        self.running = False
        self.last_ns: int | None = None
        """When the last pass was over."""
        self._fan_out, self._topic, self._framing = fan_out, topic, framing
        self._subscription = subscription  # the first member's: the others want the same media type and base
        self.members: dict[Watcher, _Send] = {}
        # What members have been sent; in a pass those that have been served, and the others what was before.
        self._reading = self._before = topic.reading
        self._pass: list[Watcher] = []
        self._sends: list[_Send] = []
        self._served = 0
        self._frame = b""
        self._news = False

    def admit(self, watcher: "Watcher", send: _Send, reading: Reading) -> bool:
        """Take in who has been sent ``reading``, if that is what the others have, or get in this pass."""
        if not self.members:
            self._reading, self._pass = reading, []
        if reading is not self._reading:
            return False
        self.members[watcher] = send
        return True

    def dismiss(self, watcher: "Watcher") -> None:
        del self.members[watcher]

    def release(self, watcher: "Watcher") -> Reading:
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
        if self._topic.apart:
            self._topic.gather()
        return self._news

    def _leave_behind(self, full: Iterable["Watcher"]) -> None:
        for watcher in full:
            if watcher in self.members:  # it can have left since the pass began
                watcher.fall_behind(self._topic, self._before)

    def _begin(self) -> bool:
        self._fan_out.freshen(self._topic)
        self._news = False
        if not self.members or not self._topic.differs(self._reading):  # it may have moved back since
            return False
        try:
            message = self._fan_out.message(self._topic, self._subscription)
        except WriteError as error:
            _log.warning("%d subscriptions of %s get no message: %s", len(self.members), self._topic.path, error)
            return False
        self._frame = message.framed(self._framing)
        self._before, self._reading = self._reading, self._topic.reading
        self._pass, self._sends, self._served = list(self.members), list(self.members.values()), 0
        return True
