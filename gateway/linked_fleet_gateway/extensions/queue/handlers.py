"""The actions of orders: withdraw, and move."""

import time
from collections.abc import Callable, Mapping

from msgspec.structs import replace

from linked_fleet_base.errors import InsufficientScope
from linked_fleet_gateway.api import (
    ActionRequest,
    Call,
    Conflict,
    Core,
    NamedNode,
    NotFound,
    Operation,
    Right,
    Table,
    UnprocessableContent,
)
from linked_fleet_gateway.extensions.queue.needs import Needs
from linked_fleet_gateway.extensions.queue.order import Order, ended
from linked_fleet_gateway.extensions.queue.ranks import passed, rank_beside
from linked_fleet_gateway.extensions.queue.terms import LF
from linked_fleet_gateway.extensions.rules.rule_invocation import path_in_fleet
from linked_fleet_gateway.faces import Identity
from linked_fleet_gateway.serving import Caller


def handlers(
    core: Core, orders: Table[Order], needs: Needs, wake: Callable[[], None]
) -> Mapping[NamedNode, Callable[[ActionRequest], Operation]]:
    """Return the handlers of the actions of orders by kind."""

    def withdraw(request: ActionRequest) -> Operation:
        async def run(call: Call) -> None:
            def change(order: Order) -> Order:
                _check_rights(needs, order, call.caller)
                return withdrawn(order, call.client)

            await _change(orders, request.member_id, change)
            wake()
            call.accept()

        return Operation(run)

    def move(request: ActionRequest) -> Operation:
        other, before = _beside(core, request)

        async def run(call: Call) -> None:
            def change(order: Order) -> Order:
                rank = _rank(orders, request.member_id, other, before=before)
                _check_rights(needs, order, call.caller)
                _check_passed(passed(orders.known, request.member_id, rank), order, call.caller.identity)
                return replace(order, rank=rank)

            await _change(orders, request.member_id, change)
            wake()
            call.accept()

        return Operation(run)

    return {LF.WithdrawOrder: withdraw, LF.MoveOrder: move}


async def _change(orders: Table[Order], id: str, change: Callable[[Order], Order]) -> None:
    if await orders.update(id, change) is None:
        raise NotFound("The order has been deleted.")


def withdrawn(order: Order, client: str) -> Order:
    """Return an order that somebody withdraws. Raises Conflict."""
    reason = f"withdrawn by {client}" if client else "withdrawn"
    if order.is_over:
        raise Conflict(f"The order is over: it is {order.state}.")
    if order.state == "waiting":
        return ended(order, "cancelled", reason, time.time_ns())
    return replace(order, cancelling=order.cancelling or reason)


def _beside(core: Core, request: ActionRequest) -> tuple[str, bool]:
    """Return the id of the order beside which a body puts another one, and whether before it."""
    named = [
        (request.body.node(request.body.root, each), each == LF.beforeOrder) for each in (LF.beforeOrder, LF.afterOrder)
    ]
    given = [(node.value, before) for node, before in named if isinstance(node, NamedNode)]
    if len(given) != 1:
        raise UnprocessableContent("An order is moved either before or after another one.")
    iri, before = given[0]
    path = path_in_fleet(iri, (request.base, *core.public_urls)) or ""
    if not path.startswith("/queue/"):
        raise UnprocessableContent(f"{iri[:200]} is no order of this queue.")
    return path.removeprefix("/queue/"), before


def _rank(orders: Table[Order], id: str, other: str, *, before: bool) -> float:
    """Return the new rank of an order. Raises Conflict, UnprocessableContent."""
    known = orders.known
    for each in (id, other):
        if each not in known or known[each].state != "waiting":
            raise Conflict("Orders are moved while both of them wait.")
    if id == other:
        raise UnprocessableContent("An order is moved beside another one.")
    if known[id].wanted.priority != known[other].wanted.priority:
        raise Conflict(
            f"The orders have the priorities {known[id].wanted.priority} and {known[other].wanted.priority};"
            " an order is moved among those of its priority. Change its priority first."
        )
    return rank_beside(known, id, other, before=before)


def _check_rights(needs: Needs, order: Order, caller: Caller) -> None:
    """Raise InsufficientScope for a caller who has not ordered it and may not act on all robots that it names."""
    identity = caller.identity
    robots = {*order.robots, *needs.robots_of(order)}
    missing = sorted(each for each in robots if not identity.has_right(Right.ACT, each))
    if missing and order.client != (identity.name or caller.name):
        wanted = f"The order uses {', '.join(missing)[:200]}; changing it takes the right to act on them."
        raise InsufficientScope(wanted, scope=Right.ACT)


def _check_passed(clients: set[str], order: Order, caller: Identity) -> None:
    """Raise InsufficientScope if an order would pass those of other clients, and the caller may not decide that."""
    if clients - {order.client} and not caller.has_right(Right.ADMIN, None):
        raise InsufficientScope(
            "Moving an order before orders of other clients takes the right to administer the fleet.", scope=Right.ADMIN
        )
