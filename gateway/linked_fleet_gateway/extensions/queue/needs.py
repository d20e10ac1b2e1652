"""The needs of each order: the robots that its mission and its values name, and those that its choice allows."""

import asyncio
import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from linked_fleet_gateway.api import Busy, Core, FleetError, NamedNode, Right, cancel_tasks, robot_of, supervised
from linked_fleet_gateway.extensions.missions.mission import Mission
from linked_fleet_gateway.extensions.missions.targets import Targets
from linked_fleet_gateway.extensions.query.service import Queries
from linked_fleet_gateway.extensions.queue.order import Choice, Order
from linked_fleet_gateway.extensions.queue.robots import Robots
from linked_fleet_gateway.extensions.queue.turns import Need
from linked_fleet_gateway.extensions.rules.rule_invocation import path_in_fleet
from linked_fleet_gateway.faces import Identity, View

log = logging.getLogger(__name__)
CLIENT = "queue"
"""Client of the queries of orders, so that no queries of others count for it."""
_FRESH_S = 5.0
_COSTLY_S = 60.0  # until a query that failed is asked again
_UNUSED_S = 60.0


@dataclass
class _Selection:
    """The robots that a query has selected, or why there is no answer."""

    order: Order
    robots: frozenset[str] | None = None
    error: str = "its query has not been answered yet"
    due_s: float = 0.0
    used_s: float = 0.0


class Selections:
    """Evaluates the queries of choices one after the other, with the rights of who has ordered."""

    def __init__(self, core: Core, targets: Targets, queries: Queries) -> None:
        self._core, self._targets, self._queries = core, targets, queries
        self._held: dict[tuple[str, str, str], _Selection] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._asked = asyncio.Event()

    async def __aenter__(self) -> "Selections":
        self._tasks = [supervised(self._evaluate, "queries of orders", log, "queries of orders are not evaluated", 0.1)]
        return self

    async def __aexit__(self, *_: object) -> None:
        await cancel_tasks(self._tasks)

    def of(self, order: Order) -> _Selection:
        """Return what is known of the query of an order, and have it evaluated again if that is old."""
        assert order.wanted.choice is not None
        key = order.wanted.choice.select, order.base, order.client
        found = self._held.setdefault(key, _Selection(order))
        found.used_s = time.monotonic()
        if found.due_s <= found.used_s:
            self._asked.set()
        return found

    async def _evaluate(self) -> None:
        await self._asked.wait()
        self._asked.clear()
        for key, each in list(self._held.items()):
            if time.monotonic() - each.used_s > _UNUSED_S:
                del self._held[key]
            elif each.due_s <= time.monotonic():
                await self._ask(each)

    async def _ask(self, held: _Selection) -> None:
        order, choice = held.order, held.order.wanted.choice
        assert choice is not None
        rest_s = _FRESH_S
        try:
            sees = self._targets.identity(order.creator).visible_robots
            rows = await self._queries.select(choice.select, order.base, sees, client=CLIENT)
        except Busy:
            rest_s = 1.0
        except FleetError as error:
            held.robots, held.error, rest_s = None, f"its query fails: {error.detail}", _COSTLY_S
        else:
            terms = (next(iter(row.values()), None) for row in rows)
            iris = (each.value for each in terms if isinstance(each, NamedNode))
            held.robots = frozenset(filter(None, (robot_at(each, order.base, self._core) for each in iris)))
        held.due_s = time.monotonic() + rest_s


def robot_at(iri: str, base: str, core: Core) -> str:
    """Return the robot that has an IRI, or whose part has it; empty if there is none."""
    path = path_in_fleet(iri, (base, *core.public_urls))
    return (robot_of(path) or "") if path is not None else ""


@dataclass
class Needs:
    """Finds what orders need. ``of`` is called for each waiting order in each pass, so it remembers what it can."""

    core: Core
    targets: Targets
    selections: Selections
    _fixed: dict[str, tuple[Mission, Order, frozenset[str]]] = field(default_factory=dict)
    _able: dict[tuple[Choice, str], list[str]] = field(default_factory=dict)
    _identities: dict[str, Identity] = field(default_factory=dict)

    def begin(self, orders: Mapping[str, Order]) -> None:
        """Begin a pass over the queue."""
        self._able.clear()
        self._identities.clear()
        for id in self._fixed.keys() - orders.keys():
            del self._fixed[id]

    def mission_of(self, order: Order) -> Mission | None:
        """Return the mission of an order; None if it is not known."""
        return self.targets.missions.get(order.mission_path.rpartition("/")[2])

    def of(self, id: str, order: Order, robots: Robots) -> Need:
        """Return what a waiting order needs. Raises RightsEnded."""
        mission, choice = self.mission_of(order), order.wanted.choice
        if mission is None:
            return Need(missing="its mission is not known")
        fixed = self._robots(id, order, mission)
        if choice is None:
            return Need(fixed)
        selected = None
        if choice.select:
            found = self.selections.of(order)
            if found.robots is None:
                return Need(missing=found.error)
            selected = found.robots
        key = choice, order.client
        if key not in self._able:
            able = robots.able(choice, selected, lambda iri: robot_at(iri, order.base, self.core))
            may = self._identity(order)
            self._able[key] = [each for each in able if may.has_right(Right.ACT, each)]
        return Need(fixed, self._able[key])

    def robots_of(self, order: Order) -> frozenset[str]:
        """Return the robots that an order names, whatever its choice is."""
        mission = self.mission_of(order)
        if mission is None:
            return frozenset()
        listed = () if order.wanted.choice is None else order.wanted.choice.robots
        return self.targets.used_robots(mission, (*order.wanted.input.values(), *listed), order.base)

    def shows(self, order: Order, sees: View) -> bool:
        """Return True if those who see these robots may know of an order."""
        return sees.includes_all or all(map(sees.includes, {*order.robots, *self.robots_of(order)}))

    def _robots(self, id: str, order: Order, mission: Mission) -> frozenset[str]:
        held = self._fixed.get(id)
        if held is None or held[0] is not mission or held[1].wanted is not order.wanted:
            found = self.targets.used_robots(mission, order.wanted.input.values(), order.base)
            held = self._fixed[id] = mission, order, found
        return held[2]

    def _identity(self, order: Order) -> Identity:
        if order.client not in self._identities:
            self._identities[order.client] = self.targets.identity(order.creator)
        return self._identities[order.client]
