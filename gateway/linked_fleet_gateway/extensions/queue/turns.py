"""One pass over the queue: which orders get robots now, and why the others wait. Pure."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from linked_fleet_gateway.extensions.queue.order import Order
from linked_fleet_gateway.extensions.queue.robots import Robots, Standing

MOST_REASONS = 4


@dataclass(frozen=True)
class Need:
    """The needs of an order: robots, and one of ``able`` besides if it has a choice. ``missing`` says why it cannot be
    told.
    """

    fixed: Collection[str] = ()
    able: Collection[str] | None = None
    missing: str = ""


@dataclass(frozen=True)
class Turn:
    """The decision of a pass about an order: the reason why it waits; else its robots, and which was chosen."""

    reason: str = ""
    robots: tuple[str, ...] = ()
    chosen: str = ""


def decide(id: str, order: Order, need: Need, robots: Robots) -> Turn:
    """Decide about an order, and take or keep its robots. Orders are passed in their turn."""
    if need.missing:
        return Turn(need.missing)
    battery = order.wanted.battery
    fixed = {name: robots.standing(name, battery) for name in sorted(need.fixed)}
    kept = {name: each for name, each in fixed.items() if each.reason}
    if need.able is None:
        return _with_all(id, fixed, kept, robots)
    able = [name for name in need.able if name not in fixed]
    found: dict[str, Standing] = {}
    for name in able:
        found[name] = robots.standing(name, battery)
        if not kept and not found[name].reason:
            return _take(id, (*fixed, name), name, robots)
    if not able:
        return Turn("no robot can: none fits what the order says")
    return Turn(_told("waits for", kept) if kept else _told("no robot that can is free:", found))


def _with_all(id: str, fixed: dict[str, Standing], kept: dict[str, Standing], robots: Robots) -> Turn:
    if not kept:
        return _take(id, tuple(fixed), "", robots)
    if all(each.busy for each in kept.values()):
        robots.reserved.update(fixed)  # else orders that need fewer robots would always come first
    return Turn(_told("waits for", kept))


def _take(id: str, names: Iterable[str], chosen: str, robots: Robots) -> Turn:
    taken = tuple(sorted(names))
    robots.take(taken, id)
    return Turn(robots=taken, chosen=chosen)


def _told(begin: str, standing: dict[str, Standing]) -> str:
    told = [f"{name}, which {each.reason}" for name, each in list(standing.items())[:MOST_REASONS] if each.reason]
    more = len(standing) - MOST_REASONS
    return f"{begin} {'; '.join(told)}{f'; and {more} more' if more > 0 else ''}"
