"""The fan-out: change → watched resources → subscribers (flow "fan-out"). Nothing here blocks or does I/O.

Work is done in turns of a few milliseconds, between which the event loop serves everybody else. Frames that come while
a turn is under way are not queued: a resource is only marked, and read when its turn comes.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Protocol

from gateway.graph.paths import robot_name
from gateway.graph.resource import Redirect, Resource
from gateway.subscriptions.message import Ending, Message, Outlet
from gateway.subscriptions.subscription import Depth, Subscription
from gateway.subscriptions.topic import Topic
from gateway.subscriptions.watcher import Timer, Watcher

TURN_S = 0.004


class Tree(Protocol):
    """The resource tree under one base URL."""

    def resolve(self, path: str) -> Resource | Redirect | None: ...

    def below(self, path: str) -> Iterable[tuple[str, bool]]: ...


class FanOut:
    """All that is watched at this gateway. ``tree`` gives the present tree for a base URL."""

    def __init__(self, tree: Callable[[str], Tree]) -> None:
        self._tree = tree
        self._topics: dict[tuple[str, bool], Topic] = {}
        self._of_robot: dict[str | None, dict[Topic, None]] = {}
        self._subtrees: dict[Watcher, None] = {}
        self._absent: dict[Watcher, None] = {}
        self._dirty: dict[Topic, None] = {}
        self._runnable: deque[Watcher] = deque()
        self._turn_due = False

    def watch(
        self, subscription: Subscription, outlet: Outlet, sent: dict[str, str] | None = None, *, patient: bool = False
    ) -> Watcher:
        """Begin to watch; nothing is written before ``ready()``.

        ``sent``: versions, by path, that the subscriber has already (what it resumes from). LookupError when there is
        no such resource, unless ``patient``: such a watcher waits for the resource, and again when it is gone.
        """
        watcher = Watcher(self, subscription, outlet, dict(sent or {}), patient)
        if subscription.depth is Depth.SUBTREE:
            self._subtrees[watcher] = None
            self._rescan(watcher)
        else:
            self._find(watcher)
        if not watcher.topics and not patient:
            watcher.close()
            raise LookupError(subscription.resource)
        return watcher

    # -- what happened ----------------------------------------------------------------------------------------------

    def moved(self, robot: str) -> None:
        """A frame came: look at what can have changed by it, when there is time."""
        topics = self._of_robot.get(robot)
        if topics:
            self._mark(topic for topic in topics if topic.measured)

    def changed(self, robot: str) -> None:
        """Something else became different about a robot: presence, description, fault."""
        for watcher in list(self._absent):
            self._find(watcher)
        for watcher in list(self._subtrees):
            self._rescan(watcher)
        for name in (robot, None):
            for topic in list(self._of_robot.get(name, ())):
                self._renew(topic)

    def touched(self, path: str) -> None:
        """One resource became different, or came to be."""
        for watcher in [each for each in self._absent if each.subscription.resource == path]:
            self._find(watcher)
        for values in (True, False):
            if (topic := self._topics.get((path, values))) is not None:
                self._renew(topic)
        for watcher in list(self._subtrees):
            if path.startswith(watcher.subscription.resource):
                self._rescan(watcher)

    # -- for watchers -----------------------------------------------------------------------------------------------

    def now_s(self) -> float:
        return time.monotonic()

    def wall_ns(self) -> int:
        return time.time_ns()

    def later(self, delay_s: float, call: Callable[[], None]) -> Timer:
        return asyncio.get_running_loop().call_later(delay_s, call)

    def run(self, watcher: Watcher) -> None:
        if not watcher.running:
            watcher.running = True
            self._runnable.append(watcher)
            self._take_turn_soon()

    def message(self, topic: Topic, subscription: Subscription) -> Message:
        return topic.message(subscription.media_type, subscription.base, self._tree)

    def forget(self, watcher: Watcher) -> None:
        self._subtrees.pop(watcher, None)
        self._absent.pop(watcher, None)
        for path in list(watcher.topics):
            self._drop(watcher, path)

    # -- turns ------------------------------------------------------------------------------------------------------

    def _take_turn_soon(self) -> None:
        if not self._turn_due:
            self._turn_due = True
            asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        self._turn_due = False
        begin = time.perf_counter()
        while self._dirty and time.perf_counter() - begin < TURN_S / 2:
            topic = next(iter(self._dirty))
            del self._dirty[topic]
            if topic.refresh():
                for watcher in list(topic.watchers):
                    watcher.news(topic)
        while self._runnable and time.perf_counter() - begin < TURN_S:
            watcher = self._runnable.popleft()
            watcher.running = False
            if watcher.step():
                self.run(watcher)
        if self._dirty or self._runnable:
            self._take_turn_soon()

    def _mark(self, topics: Iterable[Topic]) -> None:
        for topic in topics:
            self._dirty[topic] = None
        if self._dirty:
            self._take_turn_soon()

    # -- topics -----------------------------------------------------------------------------------------------------

    def _resolve(self, path: str, base: str) -> Resource | None:
        found = self._tree(base).resolve(path)
        return found if isinstance(found, Resource) else None

    def _topic(self, path: str, values: bool, resource: Resource) -> Topic:
        topic = self._topics.get((path, values))
        if topic is None:
            topic = self._topics[path, values] = Topic(path, values, resource)
            self._of_robot.setdefault(_robot(path), {})[topic] = None
        elif topic.refresh():
            for watcher in list(topic.watchers):
                watcher.news(topic)
        return topic

    def _drop(self, watcher: Watcher, path: str) -> None:
        topic = watcher.leave(path)
        if not topic.watchers:
            del self._topics[topic.path, topic.values]
            self._dirty.pop(topic, None)
            group = self._of_robot[_robot(topic.path)]
            del group[topic]
            if not group:
                del self._of_robot[_robot(topic.path)]

    def _renew(self, topic: Topic) -> None:
        """Resolve the resource again: its constants, its members or its very existence may have changed."""
        watcher = next(iter(topic.watchers), None)
        if watcher is None:
            return
        resource = self._resolve(topic.path, watcher.subscription.base)
        if resource is not None:
            topic.replace(resource)
            self._mark([topic])
            return
        for watcher in list(topic.watchers):
            if not watcher.subtree and not watcher.patient:
                watcher.end(Ending.GONE)
                continue
            self._drop(watcher, topic.path)
            if not watcher.subtree:
                self._absent[watcher] = None

    def _find(self, watcher: Watcher) -> None:
        """Join the one resource that the watcher is about, or wait for it."""
        subscription = watcher.subscription
        resource = self._resolve(subscription.resource, subscription.base)
        if resource is None:
            self._absent[watcher] = None
            return
        self._absent.pop(watcher, None)
        values = subscription.depth is Depth.PROPERTIES or resource.owner != resource.path
        watcher.join(self._topic(resource.path, values, resource))
        watcher.ready()

    def _rescan(self, watcher: Watcher) -> None:
        """Bring the resources that a subtree covers up to date."""
        root, base = watcher.subscription.resource, watcher.subscription.base
        covered = dict(self._tree(base).below(root))
        for path, topic in list(watcher.topics.items()):
            # What has ended, such as an invocation, stays until its last state is sent.
            if path not in covered and topic not in self._dirty and not watcher.waits(path):
                self._drop(watcher, path)
        for path, values in covered.items():
            if path not in watcher.topics and (resource := self._resolve(path, base)) is not None:
                watcher.join(self._topic(path, values, resource))
        watcher.ready()


def _robot(path: str) -> str | None:
    """The robot whose resource is at ``path``, None for the fleet's own."""
    try:
        segment, slash, _ = path[1:].partition("/")
        return robot_name(segment) if slash else None
    except ValueError:
        return None
