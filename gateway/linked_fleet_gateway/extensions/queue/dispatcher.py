"""Gives robots to orders, in their turn (flow "orders").

All gateways do this, and one write decides. Which robots which orders have is one record: whoever replaces it has
given the robots, all of an order at once, and no robot twice. What follows can be done again by anybody: the order is
recorded as *starting*, its mission is run with an idempotency key of order and attempt, and the run is recorded. The
gateway that has given the robots does so at once, the others once that has not happened for ``TAKE_OVER_S``.
"""

import asyncio
import logging
import time
from collections.abc import Hashable
from contextlib import suppress

from msgspec.structs import replace

from linked_fleet_gateway.api import Core, FleetError, Invocation, Table, cancel_tasks, supervised, time_sliced
from linked_fleet_gateway.extensions.availability.availability import out_of_service
from linked_fleet_gateway.extensions.latches.extension import Latches
from linked_fleet_gateway.extensions.missions.record import OVER, Run
from linked_fleet_gateway.extensions.missions.runs import Runs
from linked_fleet_gateway.extensions.missions.targets import RightsEnded
from linked_fleet_gateway.extensions.queue.needs import Needs
from linked_fleet_gateway.extensions.queue.order import Assignment, Assignments, Order, State, ended, returned
from linked_fleet_gateway.extensions.queue.ranks import in_turn, rank_of_first
from linked_fleet_gateway.extensions.queue.reading import deadline_ns
from linked_fleet_gateway.extensions.queue.robots import Abilities, Robots
from linked_fleet_gateway.extensions.queue.starting import Starts
from linked_fleet_gateway.extensions.queue.turns import Turn, decide

log = logging.getLogger(__name__)
TAKE_OVER_S = 10.0
"""Time after which another gateway does what the one that has given the robots has not done."""
FORGOTTEN_S = 120.0
"""Time after which a run that nobody knows has failed."""
KEPT = 500
"""Orders that are over and kept."""
ALL = "all"
_NONE = Assignments()
_PACE_S = 0.1  # at least between two passes
_LOOK_S = 1.0  # at most


class Dispatcher:
    """Gives robots to orders; an async context manager."""

    def __init__(
        self,
        core: Core,
        orders: Table[Order],
        assigned: Table[Assignments],
        needs: Needs,
        starts: Starts,
        runs: Runs,
        most: int,
    ) -> None:
        self._core, self._orders, self._assigned, self._most = core, orders, assigned, most
        self._needs, self._starts, self._runs = needs, starts, runs
        self.reasons: dict[str, str] = {}
        """The reasons why orders wait, as of the last pass."""
        self._abilities = Abilities()
        self._latches = core.optional_service(Latches)
        self._placements = [each for extension in core.extensions for each in extension.placements]
        self._awake = asyncio.Event()
        self._since_s: dict[Hashable, float] = {}
        self._seen: set[Hashable] = set()
        self._cancelled_s: dict[str, float] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> "Dispatcher":
        self._tasks = {supervised(self._step, "orders", log, "orders get no robots", _PACE_S)}
        return self

    async def __aexit__(self, *_: object) -> None:
        await cancel_tasks(list(self._tasks))
        await self._starts.close()

    def wake(self) -> None:
        """Look at the queue soon, because something has changed."""
        self._awake.set()

    def hear(self, invocation: Invocation) -> None:
        """Take note of a change of an invocation."""
        if invocation.state.terminal:
            self._awake.set()

    def reason(self, id: str, order: Order) -> str:
        """Return why an order waits, or how it has ended."""
        return self.reasons.get(id, "") if order.state == "waiting" else order.reason

    async def _step(self) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(_LOOK_S):
                await self._awake.wait()
        self._awake.clear()
        self._seen.clear()
        for part in (self._settle, self._forget, self._give):
            await part()
            await asyncio.sleep(0)  # others have a turn: thousands of orders take milliseconds
        self._since_s = {key: since_s for key, since_s in self._since_s.items() if key in self._seen}

    @property
    def _known(self) -> Assignments:
        return self._assigned.known.get(ALL, _NONE)

    def _lasts(self, *key: Hashable, most_s: float = TAKE_OVER_S) -> bool:
        """Return True once something has been so for some time, as seen here."""
        self._seen.add(key)
        now_s = time.monotonic()
        return now_s - self._since_s.setdefault(key, now_s) >= most_s

    # -- orders with robots -----------------------------------------------------------------------------------------

    async def _settle(self) -> None:
        """Go on with all orders that have robots, and take the robots of those that are over."""
        before, free = self._known, set[str]()
        async for id, given in time_sliced(list(before.orders.items())):
            order = self._orders.known.get(id)
            if order is None:
                if self._lasts("gone", id):
                    free.add(id)
            elif order.is_over or (order.state == "waiting" and order.attempt >= given.attempt):
                free.add(id)
            elif order.state == "running":
                await self._watch(id, order, given)
            elif given.owner == self._core.run or self._lasts("starting", id, given.attempt):
                self._starts.begin(id, given)
        if free and self._known is before:
            kept = {id: each for id, each in before.orders.items() if id not in free}
            await self._assigned.change(ALL, Assignments(kept))
            self._awake.set()

    async def _watch(self, id: str, order: Order, given: Assignment) -> None:
        """Record the end of a run, or cancel it if that was asked for. Raises RedisUnavailable."""
        how = self._end_of(order)
        if how is not None:
            if given.owner == self._core.run or self._lasts("over", id, given.attempt):
                await self._record_end(id, order, *how)
            return
        if order.cancelling or order.returning:
            self._cancel(id, order)
            return
        out = [each for each in order.robots if self._is_out(each)]
        if out:
            reason = f"{', '.join(out)[:200]} was taken out of service"
            await self._orders.update(
                id, lambda now: replace(now, returning=reason) if now.state == "running" and not now.returning else now
            )
            self._awake.set()

    def _is_out(self, name: str) -> bool:
        robot = self._core.robots.get(name)
        return robot is not None and out_of_service(robot) is not None

    def _end_of(self, order: Order) -> tuple[State, str] | None:
        """Return how the run of an order has ended; None if it has not."""
        run = self._runs.known.get(order.run)
        if run is not None:
            return _end_of(run) if run.phase in OVER else None
        invocation = self._core.live.invocations.get(order.run)
        if invocation is not None:
            return ("failed", invocation.reason) if invocation.is_final else None
        return ("failed", "its run is no longer known") if self._lasts("run", order.run, most_s=FORGOTTEN_S) else None

    async def _record_end(self, id: str, order: Order, state: State, reason: str) -> None:
        rank = rank_of_first(self._orders.known.values(), order.wanted.priority)

        def end(now: Order) -> Order:
            if now.state != "running" or now.run != order.run:
                return now
            if now.returning and not now.cancelling and state != "succeeded":
                return returned(now, rank)
            return ended(now, state, now.cancelling or reason, time.time_ns())

        await self._orders.update(id, end)
        self._awake.set()

    def _cancel(self, id: str, order: Order) -> None:
        """Ask to cancel a run, again and again until it is over."""
        now_s = time.monotonic()
        if now_s - self._cancelled_s.get(order.run, -_LOOK_S * 2) < _LOOK_S * 2:
            return
        self._cancelled_s = {order.run: now_s, **dict(list(self._cancelled_s.items())[:1000])}
        reason = order.cancelling or order.returning

        async def cancel() -> None:
            with suppress(FleetError):  # it is asked for again
                await self._core.cancel(order.run, reason)

        task = asyncio.create_task(cancel(), name=f"cancel order {id}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # -- waiting orders ---------------------------------------------------------------------------------------------

    async def _forget(self) -> None:
        """Delete the oldest orders that are over."""
        over = sorted((each.ended_ns, id) for id, each in self._orders.known.items() if each.is_over)
        for _, id in over[:-KEPT]:
            await self._orders.change(id, None)

    async def _give(self) -> None:
        """Decide about all waiting orders, and give robots to those whose turn it is. Raises RedisUnavailable."""
        before, orders = self._known, self._orders.known
        self._needs.begin(orders)
        robots = Robots(
            self._core.robots, self._moving(), dict(before.busy), self._abilities, self._placements,
            self._latches
        )  # fmt: skip
        given, reasons, room = dict[str, Assignment](), dict[str, str](), self._most - len(before.orders)
        now_ns, row = time.time_ns(), in_turn(orders)
        await asyncio.sleep(0)
        async for id, order in time_sliced(row):
            if id in before.orders:
                continue
            turn = (
                Turn("as many orders run as may") if len(given) >= room else await self._turn(id, order, robots, now_ns)
            )
            if turn is not None and not turn.reason:
                given[id] = Assignment(order.attempt + 1, turn.robots, turn.chosen, self._core.run)
            elif turn is not None:
                reasons[id] = turn.reason
        self._tell(reasons)
        if given and self._known is before and await self._assigned.change(ALL, Assignments(before.orders | given)):
            for id, each in given.items():
                self._starts.begin(id, each)
        elif given:
            self._awake.set()

    async def _turn(self, id: str, order: Order, robots: Robots, now_ns: int) -> Turn | None:
        """Return what is decided about a waiting order; None if it has ended."""
        if order.wanted.deadline and deadline_ns(order.wanted) <= now_ns:
            why = self.reasons.get(id, "no robot could have it")
            await self._end(id, "missed", f"its deadline passed before it could begin; until then: {why}")
            return None
        if self._needs.mission_of(order) is None and self._lasts("mission", id):
            await self._end(id, "failed", "its mission has been deleted")
            return None
        try:
            need = self._needs.of(id, order, robots)
        except RightsEnded as error:
            await self._end(id, "failed", error.detail)
            return None
        return decide(id, order, need, robots)

    async def _end(self, id: str, state: State, reason: str) -> None:
        def end(order: Order) -> Order:
            return ended(order, state, reason, time.time_ns()) if order.state == "waiting" else order

        await self._orders.update(id, end)

    def _moving(self) -> set[str]:
        """Return the robots that carry out what others than the queue have asked for."""
        invocations = self._core.live.invocations
        moving = {
            name
            for name in invocations.robots_with_open()
            if any(each.is_motion for each in invocations.open_of_robot(name))
        }
        return moving.union(*(run.robots for run in self._runs.known.values() if run.phase not in OVER))

    def _tell(self, reasons: dict[str, str]) -> None:
        """Tell who watches them why orders wait now."""
        changed = [id for id, reason in reasons.items() if self.reasons.get(id) != reason]
        self.reasons = reasons
        if changed:
            self._core.mark_changed("/queue", *(f"/queue/{id}" for id in changed))


def _end_of(run: Run) -> tuple[State, str]:
    states: dict[str, State] = {"succeeded": "succeeded", "cancelled": "cancelled"}
    return states.get(run.phase, "failed"), run.reason
