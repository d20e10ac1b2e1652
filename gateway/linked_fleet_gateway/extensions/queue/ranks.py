"""The order of the queue: priorities, turns of clients, and places that people give. Pure.

Orders are taken by priority, and within it by rank. A new order gets its rank as start-time fair queueing does: one
after the last rank of its client, and not before the order that is taken next. So the orders of several clients take
turns, however many one of them has, and the place of an order is a number that people can change.
"""

from collections.abc import Iterable, Mapping

from linked_fleet_gateway.api import Conflict
from linked_fleet_gateway.extensions.queue.order import Order

_APART = 1 / 1024  # ranks of two clients with the same turn, so that others can be moved between them


def in_turn(orders: Mapping[str, Order]) -> list[tuple[str, Order]]:
    """Return the waiting orders, the first to be taken first."""
    waiting = [(id, order) for id, order in orders.items() if order.state == "waiting"]
    waiting.sort(key=lambda item: place(*item))
    return waiting


def place(id: str, order: Order) -> tuple[float, float, int, str]:
    """Return what waiting orders are sorted by."""
    return -order.wanted.priority, order.rank, order.created_ns, id


def rank_of_new(orders: Iterable[Order], client: str, priority: int) -> float:
    """Return the rank of an order that a client adds."""
    same = [each for each in orders if each.wanted.priority == priority]
    waiting = [each.rank for each in same if each.state == "waiting"]
    reached = min(waiting) - 1 if waiting else max((each.rank for each in same), default=0.0)
    # What its client has running counts as well, or a client with one order at a time would have every turn.
    own = [each.rank for each in same if each.client == client and not each.is_over]
    rank, taken = max([reached, *own]) + 1, {each.rank for each in same}
    while rank in taken:
        rank += _APART
    return rank


def rank_of_first(orders: Iterable[Order], priority: int) -> float:
    """Return the rank of an order that is taken before all others of its priority."""
    waiting = (each.rank for each in orders if each.state == "waiting" and each.wanted.priority == priority)
    return min(waiting, default=1.0) - 1


def rank_beside(orders: Mapping[str, Order], id: str, other: str, *, before: bool) -> float:
    """Return the rank of an order that is moved directly before or after another one. Raises Conflict."""
    row = [name for name, _ in in_turn(orders) if name != id]
    at = row.index(other) if before else row.index(other) + 1
    priority = orders[other].wanted.priority
    near = [orders[name].rank for name in row[max(at - 1, 0) : at + 1] if orders[name].wanted.priority == priority]
    if len(near) == 1:
        return near[0] - 1 if before else near[0] + 1
    low, high = near
    middle = low + (high - low) / 2
    if not low < middle < high:
        raise Conflict("There is no room left between these two orders; move it before or after another one.")
    return middle


def passed(orders: Mapping[str, Order], id: str, rank: float) -> set[str]:
    """Return the clients whose orders an order passes if it gets this rank."""
    moved = orders[id]
    others = (
        each
        for name, each in in_turn(orders)
        if name != id and each.wanted.priority == moved.wanted.priority
    )  # fmt: skip
    return {each.client for each in others if rank <= each.rank <= moved.rank}
