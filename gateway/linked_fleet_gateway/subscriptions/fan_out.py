"""The fan-out from changes to watched resources to subscribers (flow "fan-out"). Nothing here blocks or does I/O.

Work is done in turns of a few milliseconds, between which the event loop serves everything else. Frames that arrive
during a turn are not queued: their resources are only marked, and read in a later turn.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, KeysView, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

from linked_fleet_gateway.resources.paths import is_below, robot_of
from linked_fleet_gateway.resources.resource import Redirect, Resource
from linked_fleet_gateway.resources.subscription import Depth, Subscription
from linked_fleet_gateway.subscriptions.broadcast import Broadcast, Ending, Outlet, Stream
from linked_fleet_gateway.subscriptions.topic import Again, Topic
from linked_fleet_gateway.subscriptions.watcher import Timer, Watcher
from linked_fleet_identity.rights import Right, View
from linked_fleet_runtime.background import TURN_S, Turns

_DONE = object()


class Tree(Protocol):
    """The interface of the resource tree under one base URL, for one view."""

    def resolve(self, path: str) -> Resource | Redirect | None: ...

    def subtree(self, path: str) -> Iterable[tuple[Resource, bool]]: ...

    def may_appear(self, path: str) -> bool: ...


class FanOut:
    """All watched resources of this gateway. ``tree`` returns the present tree for a base URL and a view.

    ``next_moved`` returns the next robot with a newer frame; None if there is none. ``reading`` returns the rights that
    a path takes instead of the right to read.
    """

    def __init__(
        self,
        tree: Callable[[str, View], Tree],
        next_moved: Callable[[], str | None] = lambda: None,
        reading: Callable[[str], Sequence[Right]] = lambda path: (),
    ) -> None:
        self.tree, self._next_moved, self._reading = tree, next_moved, reading
        self._topics: dict[str, dict[tuple[bool, View], Topic[Watcher]]] = {}
        self._of_robot: dict[str | None, dict[Topic[Watcher], None]] = {}
        self._subtrees: dict[Watcher, None] = {}
        self._absent: dict[Watcher, None] = {}
        self._scans: dict[Watcher, Iterator[None]] = {}
        self._scan_again: set[Watcher] = set()
        self._dirty: dict[Topic[Watcher], Again] = {}
        self._runnable: deque[Watcher | Broadcast[Watcher]] = deque()
        self._turns = Turns(self._work)
        self.listeners: dict[Callable[[str | None], None], Callable[[Exception], None]] = {}
        """Called at every change: with the robot's name for a frame, with None for anything else. Each has a function
        that notes its errors."""
        self.value_listeners: dict[Callable[[str], None], Callable[[Exception], None]] = {}
        """Called with the name of a robot of which values have changed that no frame has, as those of components."""
        self.messages_rendered = self.messages_sent = self.messages_conflated = 0
        # Called for each watcher; extensions use them, for example to request pictures from a camera.
        self.on_watcher_added: Callable[[Watcher], None] = lambda watcher: None
        self.on_watcher_removed: Callable[[Watcher], None] = lambda watcher: None

    def watch(
        self,
        subscription: Subscription,
        outlet: Outlet,
        known_versions: dict[str, str] | None = None,
        *,
        last_event_id: str | None = None,
        wait_if_absent: bool = False,
    ) -> Watcher:
        """Add a watcher; nothing is written before its ``schedule_send()``.

        The subscriber has already what ``known_versions`` names, versions by path, and the message with the id
        ``last_event_id``. If the resource does not exist the outlet is ended, unless ``wait_if_absent``: the watcher
        then waits for the resource, and again whenever it is gone.
        """
        watcher = Watcher(self, subscription, outlet, dict(known_versions or {}), last_event_id, wait_if_absent)
        self._begin(watcher)
        return watcher

    def _begin(self, watcher: Watcher) -> None:
        self.on_watcher_added(watcher)  # before it can end
        if watcher.watches_subtree:
            self._subtrees[watcher] = None
            self._scan_soon(watcher)
        else:
            self._find(watcher)

    def change_options(self, watcher: Watcher, subscription: Subscription) -> None:
        """Apply other options; another depth or media type starts anew from the present state of everything."""
        if subscription.options.needs_full_state(watcher.subscription.options):
            watcher.restart(subscription)
            self._begin(watcher)
        else:
            watcher.change_options(subscription)

    @property
    def watched_robots(self) -> KeysView[str | None]:
        """Live view of the robots of which something is watched; None stands for resources of no robot."""
        return self._of_robot.keys()

    @property
    def has_watchers(self) -> bool:
        """True if anything is watched, or waited for, by its path."""
        return bool(self._topics or self._absent)

    def waker(self) -> Callable[[], object]:
        """Return a function by which any thread says that ``next_moved`` returns a robot."""
        return self._turns.waker()

    # -- what happened ----------------------------------------------------------------------------------------------

    def mark_moved(self, robot: str) -> None:
        """Mark the resources that a frame of a robot can have changed."""
        _tell(self.listeners, robot)
        topics = self._of_robot.get(robot)
        if topics:
            for topic in topics:
                if topic.measured:
                    self._dirty.setdefault(topic, Again.OBSERVE)
            self._turns.schedule()

    def mark_robot_changed(self, robot: str) -> None:
        """Mark a robot whose presence, description or fault changed."""
        _tell(self.listeners, None)
        for watcher in list(self._absent):
            if robot_of(watcher.subscription.resource) in (robot, None):
                self._find(watcher)
        for watcher in self._subtrees:
            if robot_of(watcher.subscription.resource) in (robot, None):
                self._scan_soon(watcher)
        for name in (robot, None):
            self._dirty.update(dict.fromkeys(self._of_robot.get(name, ()), Again.RESOLVE))
        self._turns.schedule()

    def mark_changed(self, *paths: str) -> None:
        """Mark resources as changed."""
        _tell(self.listeners, None)
        for watcher in [each for each in self._absent if each.subscription.resource in paths]:
            self._find(watcher)
        for path in paths:
            if topics := self._topics.get(path):
                self._dirty.update(dict.fromkeys(topics.values(), Again.RESOLVE))
                self._turns.schedule()

    def mark_values_changed(self, robot: str, *paths: str) -> None:
        """Mark resources of a robot of which values have changed, which no frame has."""
        _tell(self.listeners, robot)
        _tell(self.value_listeners, robot)
        for path in paths:
            for topic in self._topics.get(path, {}).values():
                self._dirty[topic] = max(Again.READ, self._dirty.get(topic, Again.READ))
                self._turns.schedule()

    def add_resource(self, path: str) -> None:
        """Add a new resource to the watchers of the subtrees that cover it."""
        _tell(self.listeners, None)
        for watcher in self._subtrees:
            subscription = watcher.subscription
            if not is_below(path, subscription.resource) or path in watcher.topics:
                continue
            # Who watches what is above has perhaps none of the rights that this one takes.
            if self._reading(path) == self._reading(subscription.resource):
                resource = self._resolve(path, subscription)
                if resource is not None:
                    self._join(watcher, resource, values=True)

    # -- for watchers -----------------------------------------------------------------------------------------------

    def now_s(self) -> float:
        return time.monotonic()

    def call_later(self, delay_s: float, call: Callable[[], None]) -> Timer:
        return asyncio.get_running_loop().call_later(delay_s, call)

    def schedule(self, sender: Watcher | Broadcast[Watcher]) -> None:
        """Schedule a sender, whose ``step`` is then called in its turn."""
        if not sender.scheduled:
            sender.scheduled = True
            self._runnable.append(sender)
            self._turns.schedule()

    def get_broadcast(self, topic: Topic[Watcher], subscription: Subscription, stream: Stream) -> Broadcast[Watcher]:
        key = (subscription.media_type, subscription.base, stream.framing)
        broadcast = topic.broadcasts.get(key)
        if broadcast is None:
            broadcast = topic.broadcasts[key] = Broadcast(self, topic, *key, partial(self.refresh, topic))
        return broadcast

    def refresh(self, topic: Topic[Watcher]) -> None:
        if topic in self._dirty:
            self._read(topic)

    def unwatch(self, watcher: Watcher, path: str) -> None:
        topic = watcher.remove_topic(path)
        if not topic.watchers:
            places = self._topics[topic.path]
            del places[topic.with_values, topic.view]
            if not places:
                del self._topics[topic.path]
            self._dirty.pop(topic, None)
            group = self._of_robot[robot_of(topic.path)]
            del group[topic]
            if not group:
                del self._of_robot[robot_of(topic.path)]

    def remove_watcher(self, watcher: Watcher) -> None:
        self.on_watcher_removed(watcher)
        self._subtrees.pop(watcher, None)
        self._absent.pop(watcher, None)
        self._scans.pop(watcher, None)
        self._scan_again.discard(watcher)
        for path in list(watcher.topics):
            self.unwatch(watcher, path)

    # -- turns ------------------------------------------------------------------------------------------------------

    def _work(self, begin: float) -> bool:
        """Mark what frames changed, read it, scan subtrees, render and send; each gets an eighth of the turn at least.

        Rendered messages leave in one burst: writing to a reader that has gone to sleep meanwhile takes three times as
        long as writing to one that is still reading the message before.
        """
        while robot := self._next_moved():
            self.mark_moved(robot)
            if time.perf_counter() - begin > TURN_S / 8:
                break
        while self._dirty and time.perf_counter() - begin < TURN_S / 4:
            self._read(next(iter(self._dirty)))
        while self._scans and time.perf_counter() - begin < TURN_S / 2:
            self._scan_on(next(iter(self._scans)))
        ready: deque[Watcher | Broadcast[Watcher]] = deque()
        try:
            while self._runnable and self._prepare(ready, begin + TURN_S * 3 / 4):
                while ready and time.perf_counter() - begin < TURN_S:
                    sender = ready.popleft()
                    sender.scheduled = False
                    if sender.step():
                        self.schedule(sender)
        finally:
            self._runnable.extendleft(reversed(ready))
        return bool(robot or self._dirty or self._scans or self._runnable)

    def _prepare(self, ready: deque[Watcher | Broadcast[Watcher]], end: float) -> bool:
        """Add scheduled senders that have something to send, as many as can be prepared by ``end`` (s).

        Return True if there are any.
        """
        before = len(ready)
        while self._runnable and time.perf_counter() < end:
            sender, prepared = self._runnable.popleft(), False
            try:
                prepared = sender.prepare()
            finally:
                sender.scheduled = prepared  # after an error it can be scheduled again
            if prepared:
                ready.append(sender)
        return len(ready) > before

    def _read(self, topic: Topic[Watcher]) -> None:
        """Read a marked resource again; if it changed, tell its watchers."""
        again = self._dirty.pop(topic)
        if (again is not Again.RESOLVE or self._renew(topic)) and topic.refresh(again is Again.OBSERVE):
            self._tell(topic)

    def _tell(self, topic: Topic[Watcher]) -> None:
        """Tell the watchers of a resource that it has changed. Each gets the last message of all alone, and ends."""
        if topic.is_final:
            for watcher in topic.watchers:
                watcher.step_out()
        for broadcast in topic.broadcasts.values():
            if broadcast.members:
                self.messages_conflated += broadcast.mark_changed()
                self.schedule(broadcast)
        for watcher in list(topic.single_watchers):
            self.messages_conflated += watcher.has_pending_message(topic.path)
            watcher.mark_changed(topic)

    def _renew(self, topic: Topic[Watcher]) -> bool:
        """Resolve a resource again, because its constants, its members or its existence may have changed."""
        watcher = next(iter(topic.watchers))
        resource = self._resolve(topic.path, watcher.subscription)
        if resource is not None:
            topic.replace_resource(resource)
            return True
        for watcher in list(topic.watchers):
            self.unwatch(watcher, topic.path)
            if topic.path == watcher.subscription.resource:
                self._lose(watcher)
        return False

    # -- topics -----------------------------------------------------------------------------------------------------

    def _tree_of(self, subscription: Subscription) -> Tree:
        return self.tree(subscription.base, subscription.view)

    def _resolve(self, path: str, subscription: Subscription) -> Resource | None:
        found = self._tree_of(subscription).resolve(path)
        return found if isinstance(found, Resource) else None

    def _topic(self, path: str, values: bool, resource: Resource, sees: View) -> Topic[Watcher]:
        places = self._topics.setdefault(path, {})
        topic = places.get((values, sees))
        if topic is None:
            topic = places[values, sees] = Topic(self, path, values, resource, sees)
            self._of_robot.setdefault(robot_of(path), {})[topic] = None
        elif topic.refresh():
            self._tell(topic)
        return topic

    def _join(self, watcher: Watcher, resource: Resource, values: bool) -> None:
        watcher.add_topic(self._topic(resource.path, values, resource, watcher.subscription.view))
        watcher.end_if_final()
        watcher.schedule_send()

    def _find(self, watcher: Watcher) -> None:
        """Join the single resource of a watcher, or wait for it."""
        subscription = watcher.subscription
        resource = self._resolve(subscription.resource, subscription)
        if resource is None:
            self._lose(watcher)
            return
        self._absent.pop(watcher, None)
        values = subscription.depth is Depth.PROPERTIES or resource.owner_path != resource.path
        values = values and (not resource.values_only_in_documents or subscription.media_type in resource.documents)
        self._join(watcher, resource, values)

    def _lose(self, watcher: Watcher) -> None:
        """Handle a resource that does not exist: wait for it if it may come, else end the watcher."""
        subscription = watcher.subscription
        if not watcher.wait_if_absent and not self._tree_of(subscription).may_appear(subscription.resource):
            watcher.end(Ending.GONE)
        elif not watcher.watches_subtree:  # subtrees are scanned again anyway
            self._absent[watcher] = None

    # -- subtrees ---------------------------------------------------------------------------------------------------

    def _scan_soon(self, watcher: Watcher) -> None:
        """Schedule a scan of what a subtree covers; a scan in progress is completed and then repeated."""
        if watcher in self._scans:
            self._scan_again.add(watcher)
        else:
            self._scans[watcher] = self._scan(watcher)
        self._turns.schedule()

    def _scan_on(self, watcher: Watcher) -> None:
        if next(self._scans[watcher], _DONE) is not _DONE or watcher not in self._scans:
            return
        del self._scans[watcher]
        watcher.finish_scan()
        if watcher in self._scan_again:
            self._scan_again.discard(watcher)
            self._scan_soon(watcher)

    def _scan(self, watcher: Watcher) -> Iterator[None]:
        """Scan a subtree, one resource per step."""
        covered = set()
        for resource, values in self._tree_of(watcher.subscription).subtree(watcher.subscription.resource):
            covered.add(resource.path)
            if resource.path not in watcher.topics:
                self._join(watcher, resource, values)
            yield
        for path, topic in list(watcher.topics.items()):
            # A resource that has ended is kept until its last state has been sent.
            if path not in covered and topic not in self._dirty and not watcher.has_pending_message(path):
                self.unwatch(watcher, path)
        if watcher.subscription.resource not in covered:
            self._lose(watcher)


def _tell(listeners: Mapping[Any, Callable[[Exception], None]], robot: str | None) -> None:
    """Call the listeners with the name of a robot, or None."""
    for hear, note in list(listeners.items()):
        try:
            hear(robot)
        except Exception as error:  # noqa: BLE001 - of an extension: the others, and subscribers, hear of the change
            note(error)
