"""The start of an order's run: at most once for each attempt, whichever gateways try it."""

import asyncio
import logging
import time
from hashlib import blake2b

from msgspec.structs import replace

from linked_fleet_gateway.api import (
    Core,
    FleetError,
    Invocation,
    RequestEvent,
    Right,
    Table,
    cancel_tasks,
    robot_path,
)
from linked_fleet_gateway.extensions.missions.targets import Targets
from linked_fleet_gateway.extensions.queue.order import Assignment, Order, begun, ended
from linked_fleet_gateway.extensions.rules.rule_invocation import find_action
from linked_fleet_gateway.faces import invocation_path
from linked_fleet_gateway.serving import Caller

log = logging.getLogger(__name__)
RETRY_S = 1.0
_LATER = (429, 503)
"""Status codes of refusals that another try may not meet."""


class Starts:
    """Starts the runs of orders that have their robots."""

    def __init__(self, core: Core, orders: Table[Order], targets: Targets) -> None:
        self._core, self._orders, self._targets = core, orders, targets
        self._tasks: dict[tuple[str, int], asyncio.Task[None]] = {}

    async def close(self) -> None:
        """End what is being started; another gateway goes on with it with the same key."""
        await cancel_tasks(list(self._tasks.values()))

    def begin(self, id: str, given: Assignment) -> None:
        """Start the run of an attempt, unless that is under way here."""
        key = id, given.attempt
        if key not in self._tasks:
            task = asyncio.create_task(self._start(id, given), name=f"start order {id}")
            self._tasks[key] = task
            task.add_done_callback(lambda _: self._tasks.pop(key, None))

    async def _start(self, id: str, given: Assignment) -> None:
        def begin(order: Order) -> Order:
            is_next = order.state == "waiting" and order.attempt < given.attempt
            return begun(order, given, time.time_ns()) if is_next else order

        await self._orders.update_in_the_end(id, begin)
        while (order := self._starting(id, given)) is not None:
            if order.cancelling and given.owner == self._core.run:  # nobody else has invoked it so soon
                await self._end(id, given, "cancelled", order.cancelling)
                return
            try:
                invocation = await self._invoke(id, order)
            except FleetError as error:
                if error.status in _LATER:  # asked again with the same key
                    await asyncio.sleep(RETRY_S)
                    continue
                self._tell(id, order, error.status, "", error.detail)
                await self._end(id, given, "failed", error.detail)
            except Exception:  # of whatever kind: robots must not be kept for an order that nobody starts
                log.exception("order %s could not be started", id)
                await self._end(id, given, "failed", "the gateway failed; its log has the reason")
            else:
                self._tell(id, order, 202, invocation_path(invocation))
                await self._record(id, given, invocation)
            return

    def _starting(self, id: str, given: Assignment) -> Order | None:
        order = self._orders.known.get(id)
        is_so = order is not None and order.state == "starting" and order.attempt == given.attempt
        return order if is_so else None

    async def _record(self, id: str, given: Assignment, invocation: Invocation) -> None:
        def run(order: Order) -> Order:
            is_so = order.state == "starting" and order.attempt == given.attempt
            return replace(order, state="running", run=invocation.id) if is_so else order

        order = await self._orders.update_in_the_end(id, run)
        if order is None or order.run != invocation.id:
            # Somebody has ended the attempt while this gateway was away.
            await self._core.cancel(invocation.id, "its order is over")

    async def _end(self, id: str, given: Assignment, state: str, reason: str) -> None:
        def end(order: Order) -> Order:
            is_so = order.state == "starting" and order.attempt == given.attempt
            return ended(order, state, reason, time.time_ns()) if is_so else order  # type: ignore[arg-type]

        await self._orders.update_in_the_end(id, end)

    async def _invoke(self, id: str, order: Order) -> Invocation:
        """Run the mission in the name of who has ordered it. Raises FleetError."""
        identity = self._targets.identity(order.creator)
        tree = self._core.live.tree(order.base, identity.visible_robots)
        offer = find_action(tree, order.mission_path + "/actions/run", identity)
        values = values_of(order)
        caller = Caller(
            order.creator.client,
            # The key cannot equal a client's key, whose characters are all visible.
            idempotency_key=f"\x1forder {id} {order.attempt}",
            request_digest=blake2b(repr(sorted(values.items())).encode(), digest_size=16).hexdigest(),
            stoppable_robots=identity.view_for(Right.STOP),
            visible_robots=identity.visible_robots,
            rule=f"order {id}",
            identity=identity,
        )
        has_input = offer.takes_body and (values or not offer.body_is_optional)
        statements = self._core.statements(offer, order.base, values) if has_input else ()
        return await self._core.invoke(offer, order.base, caller, statements)

    def _tell(self, id: str, order: Order, status: int, invocation: str, reason: str = "") -> None:
        """Tell the audit what the queue has asked for in the name of who has ordered it."""
        robots = ", ".join(order.robots)
        self._core.tell_of_request(
            RequestEvent(order.client, "ORDER", f"/queue/{id}", robots, status, created=invocation, reason=reason)
        )


def values_of(order: Order) -> dict[str, bool | int | float | str]:
    """Return the values of the parameters of a mission, with the robot that was chosen."""
    choice = order.wanted.choice
    chosen = {} if choice is None else {choice.parameter: order.base + robot_path(order.chosen)}
    return order.wanted.input | chosen
