"""What the gateways remember together, and this one's copy: invocations, leases, settings. Outages are waited out."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable
from types import TracebackType
from typing import Self

from agents.wire.messages import Progress
from gateway.actions.store import ActionStore, News, StoreUnavailable
from gateway.ending import end
from gateway.fleet.fleet import Change
from gateway.fleet.invocations import Invocation
from gateway.fleet.lease import Lease
from gateway.graph.invocation import invocation_path
from gateway.graph.paths import lease_path
from gateway.live import Live

log = logging.getLogger(__name__)

_WATCH_S = 0.25  # between two looks at leases; a motion that is tied to one stops that much later at most
_RETRY_S = 0.5
_MAX_FETCHES = 100

StopOne = Callable[[Invocation, str], Awaitable[object]]


class Memory:
    """The copy that everything is read from; an async context manager."""

    def __init__(self, live: Live, store: ActionStore, stop: StopOne, over: Callable[[Invocation], None]) -> None:
        self._live, self._store, self._stop, self._over = live, store, stop, over
        self._unsaved: dict[str, tuple[Invocation, bool]] = {}
        self._to_save = asyncio.Event()
        self._heard_s: dict[str, float] = {}
        self._fetching: set[asyncio.Task[None]] = set()
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        try:
            await self._load()
        except StoreUnavailable as error:  # ``news`` says "lost" as soon as it is there
            log.warning("the store is away, nothing is remembered yet: %s", error)
        for task in (self._listen, self._save, self._watch):
            self._tasks.append(asyncio.create_task(task(), name=f"memory {task.__name__}"))
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await end([*self._tasks, *self._fetching])
        for invocation, _ in self._unsaved.values():
            log.warning("what became of invocation %s could not be remembered", invocation.id)

    # -- invocations ------------------------------------------------------------------------------------------------

    def save(self, invocation: Invocation) -> None:
        """Remember what became of an invocation that was opened, as soon as may be."""
        self._unsaved.setdefault(invocation.id, (invocation, False))
        self._to_save.set()

    def record(self, invocation: Invocation) -> None:
        """Remember an invocation that needed no leave: stopping."""
        self._unsaved[invocation.id] = (invocation, True)
        self._to_save.set()

    def forget(self, invocation: Invocation) -> None:
        self._live.invocations.remove(invocation.id)
        self._unsaved.pop(invocation.id, None)
        self._live.tell(invocation)

    async def fetch(self, robot: str, id: str) -> Invocation | None:
        """An invocation that another gateway began; StoreUnavailable."""
        found = await self._store.read(robot, id)
        if found is not None:
            self._put(found)
        return self._live.invocations.get(id)

    def fetch_soon(self, robot: str, progress: Progress) -> None:
        """A robot speaks of an invocation that is not known here yet: learn what it is, then take the news."""
        if len(self._fetching) < _MAX_FETCHES:  # beyond that, the end is heard of through the store
            task = asyncio.create_task(self._fetch_and_apply(robot, progress), name=f"fetch {progress.id}")
            self._fetching.add(task)
            task.add_done_callback(self._fetching.discard)

    async def _fetch_and_apply(self, robot: str, progress: Progress) -> None:
        try:
            if await self.fetch(robot, progress.id) is not None:
                self._live.on_progress(robot, progress)
        except StoreUnavailable as error:
            log.debug("invocation %s is not known here: %s", progress.id, error)

    def _put(self, found: Invocation) -> None:
        new = self._live.invocations.get(found.id) is None
        invocation = self._live.invocations.put(found)
        if invocation is None:
            return
        if new:
            self._live.fan_out.appeared(invocation_path(invocation))
        self._live.tell(invocation)
        if invocation.state.terminal:
            self._over(invocation)

    # -- leases and settings ----------------------------------------------------------------------------------------

    def control(self, robot: str, lease: Lease | None) -> None:
        """Note who has control, as the store has just said."""
        if lease is None:
            self._heard_s.pop(robot, None)
        else:
            self._heard_s[robot] = time.monotonic()
        self._changed(self._live.fleet.control(robot, lease), lease_path(robot))

    async def configured(self, robot: str) -> None:
        self._changed(self._live.fleet.configure(robot, await self._store.settings(robot)))

    def _changed(self, changes: list[Change], *paths: str) -> None:
        for change in changes:
            self._live.fan_out.changed(change.robot)
            for path in paths:
                self._live.fan_out.touched(path)

    # -- tasks ------------------------------------------------------------------------------------------------------

    async def _load(self) -> None:
        for invocation in await self._store.load():
            self._put(invocation)
        for robot, settings in (await self._store.all_settings()).items():
            self._changed(self._live.fleet.configure(robot, settings))
        for robot in {*self._live.fleet.robots, *self._live.fleet.leases}:
            self.control(robot, await self._store.lease(robot))

    async def _listen(self) -> None:
        async for news in self._store.news():
            try:
                await self._hear(news)
            except StoreUnavailable as error:  # "lost" follows
                log.debug("news could not be followed up: %s", error)

    async def _hear(self, news: News) -> None:
        if news.what == "lost":
            await self._load()
        elif news.what == "invocation":
            await self.fetch(news.robot, news.id)
        elif news.what == "deleted":
            invocation = self._live.invocations.get(news.id)
            if invocation is not None:
                self.forget(invocation)
        elif news.what == "lease":
            self.control(news.robot, await self._store.lease(news.robot))
        else:
            await self.configured(news.robot)

    async def _save(self) -> None:
        while True:
            await self._to_save.wait()
            self._to_save.clear()
            while self._unsaved:
                id, (invocation, unasked) = next(iter(self._unsaved.items()))
                try:
                    if unasked:
                        await self._store.open(invocation, unasked=True)
                    await self._store.save(invocation)
                except StoreUnavailable:
                    await asyncio.sleep(_RETRY_S)
                    continue
                if self._unsaved.get(id) == (invocation, unasked):
                    del self._unsaved[id]

    async def _watch(self) -> None:
        """Notice leases that end by themselves, and stop what is tied to one that is over."""
        known: set[str] = set()
        while True:
            await asyncio.sleep(_WATCH_S)
            robots = set(self._live.fleet.robots)
            for robot in {*(robots - known), *self._live.fleet.leases}:
                await self._look(robot)
            known = robots
            tied = [one for robot in robots for one in self._live.invocations.open_of(robot) if one.lease]
            for invocation in tied:
                lease = self._live.fleet.leases.get(invocation.robot)
                if lease is None or lease.id != invocation.lease:
                    await self._stop(invocation, "the control lease that it was tied to has ended")

    async def _look(self, robot: str) -> None:
        try:
            self.control(robot, await self._store.lease(robot))
        except StoreUnavailable:
            # Nobody can renew it now either: it ends when it would have ended.
            lease = self._live.fleet.leases.get(robot)
            if lease is not None and time.monotonic() - self._heard_s.get(robot, 0.0) > lease.duration_s:
                self.control(robot, None)
