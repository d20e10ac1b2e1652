"""The state of one subscriber in the fan-out: what is news to it, what is pending, and when the next message may go."""

import logging
import time
from collections.abc import Callable
from typing import Protocol

from linked_fleet_gateway.resources.subscription import Depth, Subscription
from linked_fleet_gateway.resources.versioning import Reading
from linked_fleet_gateway.subscriptions.broadcast import Broadcast, Ending, Outlet, SendCounter, Stream
from linked_fleet_gateway.subscriptions.topic import Topic
from linked_fleet_rdf.serialise import NoContentYet, WriteError

_log = logging.getLogger(__name__)


class Timer(Protocol):
    def cancel(self) -> None: ...


class Scheduler(SendCounter, Protocol):
    """The interface of the fan-out to a watcher."""

    def refresh(self, topic: "Topic[Watcher]") -> None:
        """Read the resource again if it is marked as changed."""

    def now_s(self) -> float:
        """Return the monotonic time."""

    def schedule(self, watcher: "Watcher") -> None:
        """Schedule the watcher, whose ``step`` is then called in its turn."""

    def call_later(self, delay_s: float, call: Callable[[], None]) -> Timer: ...

    def get_broadcast(
        self, topic: "Topic[Watcher]", subscription: Subscription, stream: Stream
    ) -> "Broadcast[Watcher]":
        """Return the broadcast for everybody who wants the same representation of a resource."""

    def unwatch(self, watcher: "Watcher", path: str) -> None:
        """Remove one of the watcher's resources."""

    def remove_watcher(self, watcher: "Watcher") -> None: ...


class Watcher:
    """Remembers which resources have news, never the news: memory is bounded by the number of watched resources.

    The policy (PROTOCOL.md, "Messages"): between two messages about a resource its values are conflated, and the last
    one always goes out. ``known_versions``: versions by path that the subscriber is known to have.
    ``last_event_id``: the id of a message that it has.

    A watcher of one resource on a stream, without interval and deadband, shares a ``Broadcast`` with others while its
    outlet has room, and then has nothing to do itself.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        subscription: Subscription,
        outlet: Outlet,
        known_versions: dict[str, str],
        last_event_id: str | None,
        wait_if_absent: bool,
    ) -> None:
        self.subscription = subscription
        self.wait_if_absent = wait_if_absent
        self.left_paths: set[str] = set()
        """Paths that a patient watcher no longer watches."""
        self.topics: dict[str, Topic[Watcher]] = {}
        self.scheduled = False
        self._scheduler, self._outlet = scheduler, outlet
        self._known, self._last_event_id = known_versions, last_event_id
        self._sent: dict[str, Reading] = {}
        self._pending: dict[str, None] = {}
        self._round: dict[str, None] = {}
        self._next_s = 0.0
        self._last_ns: int | None = None
        self._broadcast: Broadcast[Watcher] | None = None
        self._stream = self._in_step()
        self._timer: Timer | None = None
        self._whole = not self.watches_subtree

    def _in_step(self) -> Stream | None:
        """Return the outlet if this subscriber may share a broadcast, else None."""
        wanted = self.subscription
        all_wanted = wanted.interval_s <= 0 and wanted.deadband <= 0 and not self.watches_subtree
        return self._outlet if all_wanted and isinstance(self._outlet, Stream) else None

    @property
    def watches_subtree(self) -> bool:
        return self.subscription.depth is Depth.SUBTREE

    @property
    def last_sent_ns(self) -> int | None:
        """Time at which the last message was sent."""
        together = self._broadcast.last_sent_ns if self._broadcast is not None else None
        return max(filter(None, (self._last_ns, together)), default=None)

    def add_topic(self, topic: "Topic[Watcher]") -> None:
        """Watch one more resource; its present state is news unless the subscriber has it."""
        self.topics[topic.path] = topic
        self.left_paths.discard(topic.path)
        topic.watchers[self] = topic.single_watchers[self] = None
        known = self._known.pop(topic.path, None)
        if known == topic.reading.version or self._last_event_id == topic.event_id:
            self._sent[topic.path] = topic.reading
        else:
            self._pending[topic.path] = None

    def remove_topic(self, path: str) -> "Topic[Watcher]":
        topic = self.topics.pop(path)
        if self.wait_if_absent:
            self.left_paths.add(path)
        self._fall_out(topic)
        del topic.watchers[self], topic.single_watchers[self]
        self._pending.pop(path, None)
        self._round.pop(path, None)
        self._sent.pop(path, None)
        return topic

    def has_pending_message(self, path: str) -> bool:
        """Return True if a message about the resource is pending."""
        return path in self._pending or path in self._round

    def mark_changed(self, topic: "Topic[Watcher]") -> None:
        """Note the change of a resource; if it is news to this subscriber, it is sent as soon as permitted."""
        if not self.has_pending_message(topic.path) and (self.subscription.deadband <= 0 or self._is_news(topic)):
            self._pending[topic.path] = None
            self.schedule_send()

    def schedule_send(self) -> None:
        """Schedule this watcher if it has something to send and no timer runs."""
        if (self._round or self._pending) and self._timer is None:
            self._scheduler.schedule(self)

    def finish_scan(self) -> None:
        """Note that a subtree has been scanned: with an interval, the first round waits for this."""
        self._whole = True
        self.schedule_send()

    def prepare(self) -> bool:
        """Return True if it may send now; messages are rendered while sending, mostly already for others."""
        return self._timer is None

    def step(self) -> bool:
        """Send one message; return True if more may go at once.

        Messages go in rounds: a round contains everything that has news when it begins, and the interval lies between
        rounds.
        """
        if self._timer is not None or not self._outlet.writable() or not (self._round or self._begin_round()):
            return False
        path = next(iter(self._round))
        topic = self.topics[path]
        self._scheduler.refresh(topic)  # and leave it if it is gone
        self._round.pop(path, None)
        if path in self.topics and self._is_news(topic):  # it may have returned to the old value
            self._send(topic)
        if not self._round and self.subscription.interval_s > 0:
            self._next_s = self._scheduler.now_s() + self.subscription.interval_s
        if path in self.topics:  # a final resource of a subtree is left with its last message
            self.join_broadcast(path)
            self.end_if_final()
        return bool(self._round or self._pending)

    def end_if_final(self) -> None:
        """End if the subscriber has all that there will ever be of its resource."""
        alone = not self.watches_subtree and not self.wait_if_absent
        if alone and not self._pending and not self._round and any(each.is_final for each in self.topics.values()):
            self.end(Ending.FINAL)

    def join_broadcast(self, path: str) -> None:
        """Join a broadcast if nothing is pending and its members were sent the same last."""
        topic, sent = self.topics[path], self._sent.get(path)
        if topic.is_final or self.has_pending_message(topic.path):
            return
        if self._stream is not None and sent is not None:
            broadcast = self._scheduler.get_broadcast(topic, self.subscription, self._stream)
            if broadcast.admit_member(self, self._stream.send, sent):
                self._broadcast = broadcast
                del topic.single_watchers[self], self._sent[topic.path]

    def leave_broadcast(self, path: str, sent: Reading) -> None:
        """Leave the broadcast, because the outlet had no room for a message; ``sent``: the reading sent before."""
        self._fall_out(self.topics[path])
        self._sent[path] = sent
        self._pending[path] = None

    def _fall_out(self, topic: "Topic[Watcher]") -> None:
        if self._broadcast is not None:
            self._last_ns = self.last_sent_ns
            self._broadcast.remove_member(self)
            self._broadcast = None
            topic.single_watchers[self] = None

    def _begin_round(self) -> bool:
        if not self._pending or (self.subscription.interval_s > 0 and not self._whole):
            return False
        if self._next_s and (wait_s := self._next_s - self._scheduler.now_s()) > 0:
            self._timer = self._scheduler.call_later(wait_s, self._due)
            return False
        self._round, self._pending = self._pending, {}
        return True

    def change_options(self, subscription: Subscription) -> None:
        """Apply another interval and deadband. A running interval keeps its start; a first one starts now."""
        self.step_out()
        self._set(subscription)
        for topic in self.topics.values():
            if not self.has_pending_message(topic.path) and self._is_news(topic):
                self._pending[topic.path] = None
        self.schedule_send()

    def restart(self, subscription: Subscription) -> None:
        """Replace the subscription, and forget all watched resources and sent versions; they are joined anew."""
        self.step_out()
        self._scheduler.remove_watcher(self)
        self._known, self._last_event_id = {}, None
        self._set(subscription)
        self._whole = not self.watches_subtree

    def _set(self, subscription: Subscription) -> None:
        before, self.subscription = self.subscription, subscription
        self._cancel_timer()
        begun_s = self._next_s - before.interval_s if self._next_s else self._scheduler.now_s()
        waits = subscription.interval_s > 0 and self.last_sent_ns is not None
        self._next_s = begun_s + subscription.interval_s if waits else 0.0
        self._stream = self._in_step()

    def step_out(self) -> None:
        """Leave the broadcast, even in the middle of a pass."""
        if self._broadcast is None:
            return
        (topic,) = self.topics.values()  # a member of a broadcast watches one resource
        self._last_ns = self.last_sent_ns
        self._sent[topic.path] = self._broadcast.release_member(self)
        self._broadcast = None
        topic.single_watchers[self] = None

    def end(self, ending: Ending) -> None:
        self.close()
        self._outlet.end(ending)

    def close(self) -> None:
        """Stop watching; the outlet is closed elsewhere."""
        self._cancel_timer()
        self._scheduler.remove_watcher(self)

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _send(self, topic: "Topic[Watcher]") -> None:
        try:
            message = topic.message(self.subscription.media_type, self.subscription.base)
        except NoContentYet:
            return
        except WriteError as error:
            id = self.subscription.id
            _log.warning("subscription %s gets no message: %s", id, error, extra={"subscription": id})
            return
        self._sent[topic.path] = topic.reading
        self._last_ns = time.time_ns()
        self._scheduler.messages_sent += 1
        self._outlet.write(message)
        if self.watches_subtree and topic.is_final:
            self._scheduler.unwatch(self, topic.path)

    def _is_news(self, topic: "Topic[Watcher]") -> bool:
        sent, reading, deadband = self._sent.get(topic.path), topic.reading, self.subscription.deadband
        if sent is None or deadband <= 0:
            return topic.differs(sent)
        return reading is not sent and not reading.equals(sent, deadband)

    def _due(self) -> None:
        self._timer = None
        self.schedule_send()
