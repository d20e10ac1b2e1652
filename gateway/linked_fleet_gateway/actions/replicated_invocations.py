"""Replicated state of actions: invocations, leases, settings. Redis outages are waited out."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import islice
from types import TracebackType
from typing import Self

from linked_fleet_agent.wire.messages import Progress
from linked_fleet_base.errors import Controlled, RedisUnavailable
from linked_fleet_gateway.actions.refusals import translate_store_errors
from linked_fleet_gateway.actions.stop_delivery import StopDelivery
from linked_fleet_gateway.actions.store import ActionStore, News
from linked_fleet_gateway.resources.invocation import invocation_path
from linked_fleet_gateway.resources.paths import lease_path
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_runtime.background import cancel_tasks, run_last_step, supervised
from linked_fleet_runtime.redis import GATHER_S
from linked_fleet_runtime.replica import Loading, Replica, follow_changes
from linked_fleet_state.invocation import Lease, Priority
from linked_fleet_state.invocations import Invocation
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)

_WATCH_S = 0.25  # period of lease checks; a motion that is tied to a lease stops this much later at most
_FIRST_WORD_S = 1.0
_AT_ONCE = 64  # saved together
_MAX_FETCHES = 100
_MAX_UNSAVED = 10_000
_MAX_FORGOTTEN = 1000  # deletions remembered, because older reads may still arrive

StopMotion = Callable[[Invocation, str], Awaitable[object]]


class ReplicatedInvocations(Loading):
    """The local copy, which all reads use; an async context manager."""

    def __init__(
        self,
        live: Live,
        store: ActionStore,
        stop: StopMotion,
        on_change: Callable[[Invocation], None],
    ) -> None:
        self._live, self._store, self._stop, self._on_change = live, store, stop, on_change
        self.stops = StopDelivery(live, store.owed_stops)
        """Sends stops, and remembers for all gateways those that are not confirmed."""
        self._unsaved: dict[str, Invocation] = {}
        self._unasked: set[str] = set()  # created without the store's permission and not yet stored
        self._to_save = asyncio.Event()
        self._own: set[str] = set()
        self._asked: set[str] = set()
        self._forgotten: dict[str, None] = {}  # oldest first
        self._dropped = False
        self._settings = Replica(store.read_all_settings, store.read_settings, self._configure)
        live.copies.add("stops, motions, settings and placements", self, needed_by_motions=True)
        self._ends_s: dict[str, float] = {}  # monotonic ends of leases by robot, as last known
        self._fetching: set[asyncio.Task[None]] = set()
        self._stopping: dict[str, asyncio.Task[None]] = {}
        self._looked_at: set[str] = set()
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        await self.stops.__aenter__()
        self._tasks = [
            await follow_changes("stops, invocations and leases", log, self._load, self._hear, self._store.news),
            supervised(self._save, "save invocations", log, "invocations are not saved", GATHER_S),
            supervised(self._look, "look at leases", log, "leases are not up to date", 0.0),
            supervised(self._watch, "watch leases", log, "motions may outlive their leases", 0.0),
        ]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks([*self._tasks, *self._fetching, *self._stopping.values()])
        await self.stops.__aexit__(kind, error, trace)
        if self._unsaved:
            await run_last_step(self._save(), log, "the last invocations could not be saved")
        for id in self._unsaved:
            log.warning("what became of invocation %s could not be remembered", id)

    # -- invocations ------------------------------------------------------------------------------------------------

    def mark_own(self, invocation: Invocation) -> None:
        """Mark an invocation as this gateway's own until it has ended."""
        self._own.add(invocation.id)

    @contextmanager
    def defer_end(self, invocation: Invocation) -> Iterator[None]:
        """Hold back the end of an invocation while its agent is asked to start it.

        An end is written once, and would lack what only the agent's reply contains.
        """
        self._asked.add(invocation.id)
        try:
            yield
        finally:
            self._asked.discard(invocation.id)
            if invocation.state.terminal:
                self.save(invocation)

    def store_end(self, invocation: Invocation) -> None:
        """Store the end of an invocation. The gateway that started it writes first, because it knows most."""
        if invocation.id in self._own:
            self._own.discard(invocation.id)
            if invocation.id not in self._asked:
                self.save(invocation)
        else:
            self._soon(self._settle_for_another(invocation), f"settle {invocation.id}")

    async def _settle_for_another(self, invocation: Invocation) -> None:
        while True:
            await asyncio.sleep(_FIRST_WORD_S)
            with suppress(RedisUnavailable):
                found = await self._store.read_invocation(invocation.robot, invocation.id)
                break
        if found is not None and not found.is_final:
            if self._live.invocations.get(invocation.id) is invocation:
                self._put(found)
            self.save(invocation)

    def is_own(self, invocation: Invocation) -> bool:
        """Return True if this gateway started it and has not seen its end."""
        return invocation.id in self._own

    async def is_late(self, invocation: Invocation) -> bool:
        """Return True if an open one is past its deadline at all gateways. Raises RedisUnavailable."""
        if not self.is_own(invocation):
            await self.fetch(invocation.robot, invocation.id)
        return not invocation.state.terminal and time.time_ns() > invocation.deadline_ns

    def save(self, invocation: Invocation) -> None:
        """Store the state of an opened invocation as soon as possible.

        If too many wait during an outage of Redis, the oldest ended one is dropped.
        """
        self._unsaved.setdefault(invocation.id, invocation)
        self._to_save.set()
        if len(self._unsaved) > _MAX_UNSAVED:
            self._drop()

    def _drop(self) -> None:
        ended = (id for id, one in self._unsaved.items() if one.state.terminal)
        id = next(ended, next(iter(self._unsaved)))
        del self._unsaved[id]
        self._unasked.discard(id)
        if not self._dropped:
            log.warning("more than %d invocations could not be remembered; the oldest are given up", _MAX_UNSAVED)
        self._dropped = True

    def save_stop(self, invocation: Invocation) -> None:
        """Store an invocation that needed no permission, which is a stop."""
        self._unasked.add(invocation.id)
        self.save(invocation)

    def forget(self, id: str) -> None:
        """Forget a deleted invocation; copies read earlier are ignored when they arrive."""
        self._forgotten[id] = None
        if len(self._forgotten) > _MAX_FORGOTTEN:
            del self._forgotten[next(iter(self._forgotten))]
        self._own.discard(id)
        self._unsaved.pop(id, None)
        self._unasked.discard(id)
        invocation = self._live.invocations.remove(id)
        if invocation is not None:
            self._live.mark_invocation_changed(invocation)
            self._on_change(invocation)

    async def fetch(self, robot: str, id: str) -> Invocation | None:
        """Read an invocation of another gateway. Raises RedisUnavailable."""
        found = await self._store.read_invocation(robot, id)
        if found is not None:
            self._put(found)
        return self._live.invocations.get(id)

    def fetch_soon(self, robot: str, progress: Progress) -> None:
        """Read an unknown invocation that a robot reports on, then apply the progress."""
        if len(self._fetching) < _MAX_FETCHES:  # beyond that, its end arrives through the store
            self._soon(self._fetch_and_apply(robot, progress), f"fetch {progress.id}")

    def _soon(self, doing: Coroutine[None, None, None], name: str) -> None:
        task = asyncio.create_task(doing, name=name)
        self._fetching.add(task)
        task.add_done_callback(self._fetching.discard)

    async def _fetch_and_apply(self, robot: str, progress: Progress) -> None:
        try:
            if await self.fetch(robot, progress.id) is not None:
                self._live.on_progress(robot, progress)
        except RedisUnavailable as error:
            log.debug("invocation %s is not known here: %s", progress.id, error)

    def _put(self, found: Invocation) -> None:
        if found.id in self._forgotten:
            return
        new = self._live.invocations.get(found.id) is None
        invocation = self._live.invocations.put(found)
        if invocation is None:
            return
        if new:
            self._live.fan_out.add_resource(invocation_path(invocation))
        self._live.mark_invocation_changed(invocation)
        if invocation.state.terminal:
            self._own.discard(invocation.id)
        self._on_change(invocation)

    # -- leases and settings ----------------------------------------------------------------------------------------

    async def take_lease(
        self, robot: Robot, holder: str, duration_s: float, token: str, priority: Priority | None, *, own: str = ""
    ) -> tuple[Lease, str]:
        """Take or renew control of a robot. Return the lease and its secret token; ``own`` is that of a new lease.

        Raises Controlled, RedisUnavailable.
        """
        read_at_s = time.monotonic()
        with translate_store_errors():
            lease, proof = await self._store.take_lease(robot.name, holder, duration_s, token, priority, own=own)
        self.update_lease(robot.name, lease, read_at_s)
        return lease, proof

    async def hand_over_lease(
        self, robot: Robot, token: str, new_token: str, holder: str, duration_s: float, *, may_be_person: bool
    ) -> bool:
        """Give control of a robot to another holder. Return False if nobody has it.

        Raises Controlled, RedisUnavailable.
        """
        read_at_s = time.monotonic()
        with translate_store_errors():
            lease = await self._store.hand_over_lease(
                robot.name, token, new_token, holder, duration_s, may_be_person=may_be_person
            )
        self.update_lease(robot.name, lease, read_at_s)
        return lease is not None

    async def has_lease(self, robot: Robot, token: str) -> bool:
        """Return True if the lease of a robot is held by this token. Raises RedisUnavailable."""
        with translate_store_errors():
            if await self._store.read_lease(robot.name) is None:
                return False
        try:
            with translate_store_errors():
                await self._store.check_lease(robot.name, token)
        except Controlled:
            return False
        return True

    async def release_lease(self, robot: Robot, token: str) -> bool:
        """Release control. Return False if nobody has it. Raises Controlled, RedisUnavailable."""
        with translate_store_errors():
            released = await self._store.release_lease(robot.name, token)
        self.update_lease(robot.name, None)
        return released

    async def set_setting(self, robot: Robot, name: str, value: str | None, token: str) -> bool:
        """Replace the known value of a setting for all gateways, or remove it for None.

        Returns False, without a change, if another gateway has changed it; its value is then known. Raises Controlled,
        RedisUnavailable.
        """
        present = self._setting(robot, name)  # before anything is awaited: what the caller knows
        with translate_store_errors():
            await self._store.check_lease(robot.name, token)
        return await self._replace_setting(robot, name, present, value)

    async def change_setting(self, robot: Robot, name: str, value: str | None) -> bool:
        """Replace a setting like ``set_setting``, whoever has control of the robot. Raises RedisUnavailable."""
        return await self._replace_setting(robot, name, self._setting(robot, name), value)

    def _setting(self, robot: Robot, name: str) -> str | None:
        return self._live.fleet.settings.get(robot.name, {}).get(name)

    async def _replace_setting(self, robot: Robot, name: str, present: str | None, value: str | None) -> bool:
        with translate_store_errors():
            step = self._store.set_setting(robot.name, name, present, value)
            return await self._settings.write(robot.name, step)

    async def forget_robot(self, robot: str, token: str) -> None:
        """Remove a robot that is offline, at all gateways, with its settings. Raises Controlled, RedisUnavailable."""
        with translate_store_errors():
            await self._store.check_lease(robot, token)
            await self._store.forget_robot(robot)
        await self._drop_robot(robot)

    async def _drop_robot(self, robot: str) -> None:
        await self._settings.refresh(robot)
        for invocation in self._live.invocations.of_robot(robot):
            self.forget(invocation.id)
        self._live.forget_robot(robot)

    def update_lease(self, robot: str, lease: Lease | None, read_at_s: float = 0.0) -> None:
        """Record the lease of a robot, read from the store at ``read_at_s`` (monotonic)."""
        if lease is None:
            self._ends_s.pop(robot, None)
        else:
            self._ends_s[robot] = read_at_s + lease.left_s
        if self._live.fleet.control(robot, lease):
            self._live.fan_out.mark_changed(lease_path(robot))

    def _configure(self, robot: str, settings: Mapping[str, str] | None) -> None:
        if self._live.fleet.configure(robot, settings or {}):
            self._live.fan_out.mark_robot_changed(robot)

    # -- tasks ------------------------------------------------------------------------------------------------------

    async def _load(self) -> None:
        with self.loading():
            await self.stops.load()
            for invocation in await self._store.load_invocations():
                self._put(invocation)
            await self._settings.load()
            for robot in {*self._live.fleet.robots, *self._live.fleet.leases}:
                await self._look_at(robot)

    async def _hear(self, news: News) -> None:
        if news.kind == "invocation":
            await self.fetch(news.robot, news.id)
        elif news.kind == "deleted":
            self.forget(news.id)
        elif news.kind == "stop":
            await self.stops.refresh((news.robot, news.id))
        elif news.kind == "lease":
            await self._look_at(news.robot)
        elif news.kind == "forgotten":
            await self._drop_robot(news.robot)
        else:
            await self._settings.refresh(news.robot)

    async def _save(self) -> None:
        """Store the invocations that wait. Those that come meanwhile are gathered for the next call."""
        await self._to_save.wait()
        for _ in range(0, len(self._unsaved), _AT_ONCE):
            await self._save_oldest()
        if not self._unsaved:
            self._to_save.clear()
            self._dropped = False

    async def _save_oldest(self) -> None:
        # Removed first, so that changes made meanwhile are saved again.
        taken = dict(islice(self._unsaved.items(), _AT_ONCE))
        for id in taken:
            del self._unsaved[id]
        try:
            unasked = self._unasked.intersection(taken)
            await self._store.save_all(list(taken.values()), unasked)
            self._unasked -= unasked
        except BaseException:  # also cancellation
            self._unsaved = {**taken, **self._unsaved}  # still the oldest
            raise

    async def _look(self) -> None:
        """Notice ended leases, and leases of robots that appear."""
        await asyncio.sleep(_WATCH_S)
        robots = set(self._live.fleet.robots)
        for robot in {*(robots - self._looked_at), *self._live.fleet.leases}:
            with suppress(RedisUnavailable):
                await self._look_at(robot)
        self._looked_at = robots

    async def _look_at(self, robot: str) -> None:
        """Read a lease, again if it was taken or released meanwhile, because the answer may be outdated."""
        while True:
            asked_s, before = time.monotonic(), self._live.fleet.leases.get(robot)
            lease = await self._store.read_lease(robot)
            if self._live.fleet.leases.get(robot) is before:
                break
        self.update_lease(robot, lease, asked_s)

    async def _watch(self) -> None:
        """Stop motions tied to an ended lease, even during an outage of Redis, when nobody can renew."""
        await asyncio.sleep(_WATCH_S)
        now_s = time.monotonic()
        for robot in [robot for robot, ends_s in self._ends_s.items() if now_s > ends_s + _WATCH_S]:
            self.update_lease(robot, None)
        robots = list(self._live.fleet.robots)
        for invocation in [one for robot in robots for one in self._live.invocations.open_of_robot(robot) if one.lease]:
            lease = self._live.fleet.leases.get(invocation.robot)
            if (lease is None or lease.id != invocation.lease) and invocation.id not in self._stopping:
                stopping = asyncio.create_task(self._stop_tied(invocation), name=f"stop {invocation.id}")
                self._stopping[invocation.id] = stopping

    async def _stop_tied(self, invocation: Invocation) -> None:
        """Stop one motion in a task of its own, so that a silent robot delays no others."""
        try:
            await self._stop(invocation, "the control lease that it was tied to has ended")
        finally:
            del self._stopping[invocation.id]
