"""Gateways in the test's process: the product's stores and services, as runs that can be killed."""

import asyncio
import random
import ssl
from collections.abc import Coroutine, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import Any
from unittest.mock import patch
from weakref import WeakSet

from histories.history import History
from histories.robots import LossyLink, Toy
from linked_fleet_gateway.actions import lifecycle as lifecycle_module
from linked_fleet_gateway.actions import service as actions_module
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.actions.store import ActionStore
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.rules.store import RuleStore
from linked_fleet_gateway.extensions.world.service import stored_objects
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_gateway.subscriptions import callbacks as callbacks_module
from linked_fleet_gateway.subscriptions import courier as courier_module
from linked_fleet_gateway.subscriptions import service as subscriptions_module
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.service import Subscriptions, new_run_name
from linked_fleet_gateway.subscriptions.store import SubscriptionStore
from linked_fleet_runtime.background import cancel_tasks
from linked_fleet_webhooks.network import Network
from linked_fleet_webhooks.receiver import DeliveryOutcome, Verdict
from virtual.zenoh_network import ZenohNetwork

NAMESPACE = "histories"
LEASE_S = 0.8
"""The lease of a gateway, after which others take over its subscriptions."""
_LIMIT = 100_000
_ANSWER_LOST, _REFUSED = 0.05, 0.05  # shares of deliveries


@contextmanager
def hurried() -> Iterator[None]:
    """Make services check and retry more often than in production."""
    with (
        patch.object(actions_module, "ANSWER_TIMEOUT_S", 0.1),
        patch.object(lifecycle_module, "ANSWER_TIMEOUT_S", 0.1),
        patch.object(subscriptions_module, "KEEP_S", 0.1),
        patch.object(subscriptions_module, "RECONCILE_S", 0.5),
        patch.object(courier_module, "_STORE_PAUSE_S", 0.02),
        patch.object(courier_module, "backoff_s", lambda failures, draw: 0.01),
        patch.object(courier_module, "SUSPEND_AFTER", _LIMIT),
    ):
        yield


class Watched:
    """Resources that count up, the same for all gateways, each of which watches them by its own fan-out."""

    def __init__(self, count: int) -> None:
        self.paths = [f"/toy/{number}" for number in range(count)]
        self._ranks = dict.fromkeys(self.paths, 0)
        self._rank_of: dict[tuple[str, str], int] = {}
        self._fan_outs: list[FanOut] = []
        for path in self.paths:
            self._note(path)

    def _note(self, path: str) -> None:
        self._rank_of[path, self._source(path).read().version] = self._ranks[path]

    def _source(self, path: str) -> Source:
        return Source(facts=lambda: (path, self._ranks[path]))

    def watch(self) -> FanOut:
        """Return a fan-out for another gateway."""
        self._fan_outs.append(FanOut(lambda base, sees: self))
        return self._fan_outs[-1]

    def forget(self, fan_out: FanOut) -> None:
        self._fan_outs.remove(fan_out)

    def advance(self, path: str) -> None:
        self._ranks[path] += 1
        self._note(path)
        for fan_out in self._fan_outs:
            fan_out.mark_changed(path)

    def rank(self, path: str, version: str | None = None) -> int:
        """Return the number of changes of the resource up to this version, or up to the present one."""
        return self._ranks[path] if version is None else self._rank_of[path, version]

    def resolve(self, path: str) -> Resource | None:
        return Resource(path, "a counter", lambda graph: None, source=self._source(path))

    def subtree(self, path: str) -> list[tuple[str, bool]]:
        return [(path, True)]


class Deliveries:
    """The receivers of all callbacks. They record each message, even if its response is lost."""

    def __init__(self, history: History, watched: Watched, draws: random.Random) -> None:
        self._history, self._watched, self._draws = history, watched, draws
        self.last: dict[str, int] = {}
        """Rank of the last new message, by subscription."""
        self._numbers: dict[str, int] = {}

    def take(self, subscription: str, headers: Mapping[str, str]) -> DeliveryOutcome:
        draw = self._draws.random()
        if draw < _REFUSED:
            return DeliveryOutcome(Verdict.RETRY, 503, None, "busy")
        path = headers["Link"].partition(">")[0].removeprefix("<http://fleet.example")
        number, version = int(headers["Linked-Fleet-Delivery"]), headers["Linked-Fleet-Version"]
        rank, now_ns = self._watched.rank(path, version), self._history.now_ns()
        self._history.happened("callback", subscription, "deliver", now_ns, number=number, content=version, rank=rank)
        if number > self._numbers.get(subscription, 0):
            self._numbers[subscription], self.last[subscription] = number, rank
        lost = draw < _REFUSED + _ANSWER_LOST
        return (
            DeliveryOutcome(Verdict.RETRY, None, None, "lost")
            if lost
            else DeliveryOutcome(Verdict.DELIVERED, 204, None, "")
        )

    def receiver(
        self, network: Network, url: str, *, ssl_context: ssl.SSLContext, consent_throttle: object
    ) -> "_Receiver":
        return _Receiver(self, url.rpartition("/")[2])


class _Receiver:
    """Replaces the product's receiver, which speaks HTTP."""

    def __init__(self, deliveries: Deliveries, subscription: str) -> None:
        self._deliveries, self._subscription = deliveries, subscription

    async def deliver(self, body: bytes, content_type: str, headers: Mapping[str, str], **_: Any) -> DeliveryOutcome:
        await asyncio.sleep(0)
        outcome = self._deliveries.take(self._subscription, headers)
        await asyncio.sleep(0)
        return outcome

    async def aclose(self) -> None: ...


_owner: ContextVar[WeakSet[asyncio.Task[Any]] | None] = ContextVar("owner", default=None)


def note_owners() -> None:
    """Make this event loop record the gateway of each task, so that killing a gateway ends them all."""

    def make(loop: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, Any], **more: Any) -> asyncio.Task[Any]:
        task = asyncio.Task(coroutine, loop=loop, **more)
        if (owned := more["context"].get(_owner) if more.get("context") else _owner.get()) is not None:
            owned.add(task)
        return task

    asyncio.get_running_loop().set_task_factory(make)


class Gateway:
    """One run, from ``start`` until it is killed; its parts are the product's own."""

    def __init__(self, url: str, watched: Watched, robots: Mapping[str, Toy], draws: random.Random) -> None:
        self.run = new_run_name()
        self.store = ActionStore(url, NAMESPACE, self.run)
        self.objects, self.rules = stored_objects(url, NAMESPACE), RuleStore(url, NAMESPACE, self.run)
        self.live = create_live(GatewaySettings(), ZenohNetwork().gateway(self.run))
        self.live.link = LossyLink(robots, draws)  # type: ignore[assignment]
        self._robots, self._watched, self._fan_out = robots, watched, watched.watch()
        self._remembered = ActionStore(url, NAMESPACE, self.run)
        self.actions = Actions(self.live, self._remembered, _LIMIT)
        self._network = Network()
        self._subscribed = SubscriptionStore(url, NAMESPACE, self.run, LEASE_S)
        self.subscriptions = Subscriptions(
            self._subscribed, self.run, self._fan_out, self._network, consent_required=False, limit=_LIMIT
        )
        self._tasks: WeakSet[asyncio.Task[Any]] = WeakSet()
        self._context = copy_context()
        self._context.run(_owner.set, self._tasks)

    def task(self, coroutine: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Run a coroutine at this gateway, with which it ends."""
        return asyncio.create_task(coroutine, context=self._context)

    async def start(self) -> None:
        for robot in self._robots.values():
            robot.meet(self.live, self._context)
        await self.task(self._enter())

    async def _enter(self) -> None:
        for part in (self.store, self._remembered, self.actions, self.subscriptions):
            await part.__aenter__()

    async def kill(self) -> None:
        """End like a killed process. Its connection to the store is gone already, so no part of it sends anything."""
        for robot in self._robots.values():
            robot.leave(self.live)
        self._watched.forget(self._fan_out)
        while alive := [task for task in self._tasks if not task.done()]:  # an ending task may start another one
            await cancel_tasks(alive)
        for store in (self.store, self._remembered, self._subscribed):
            await store._redis.close()
        await self.objects.close()
        await self.rules.close()
        self._network.close()


def receivers(deliveries: Deliveries) -> Any:
    """Send callbacks to ``deliveries`` within this context."""
    return patch.object(callbacks_module, "Receiver", deliveries.receiver)
