"""The orders as the members of their container: what clients add, change and delete, and how many."""

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from msgspec.structs import replace

from linked_fleet_base.errors import ContainerFull
from linked_fleet_gateway.api import Conflict, Core, Table, UnprocessableContent
from linked_fleet_gateway.extensions.missions.targets import Targets
from linked_fleet_gateway.extensions.queue.order import Order
from linked_fleet_gateway.extensions.queue.ranks import rank_of_new
from linked_fleet_gateway.extensions.rules.rule_invocation import path_in_fleet


@dataclass(frozen=True)
class OrderRecords:
    """The orders, of which at most ``most`` wait, and ``most_of_client`` of one client."""

    core: Core
    table: Table[Order]
    targets: Targets
    most: int
    most_of_client: int

    @property
    def known(self) -> Mapping[str, Order]:
        return self.table.known

    async def add(self, record: Order) -> str:
        """Add an order. Raises ContainerFull, RedisUnavailable."""
        return await self.table.add(self.new(record))

    def new(self, record: Order) -> Order:
        """Return an order as the last one of its client. Raises ContainerFull."""
        self._check_room(record)
        rank = rank_of_new(self.known.values(), record.client, record.wanted.priority)
        return self._named(replace(record, created_ns=time.time_ns(), rank=rank))

    async def change(self, id: str, record: Order | None) -> bool:
        """Replace what an order that waits wants, or delete an order that does not run. Raises Conflict."""
        present = self.known.get(id)
        if present is None:
            return False
        if record is None:
            if present.state in ("starting", "running"):
                raise Conflict("The order is running: withdraw it first.")
            return await self.table.change(id, None)
        if present.state != "waiting":
            raise Conflict(f"The order is {present.state}; what it wants can be changed while it waits.")
        rank = present.rank
        if record.wanted.priority != present.wanted.priority:
            rank = rank_of_new(self.known.values(), record.client, record.wanted.priority)
        changed = replace(present, wanted=record.wanted, creator=record.creator, rank=rank)
        return await self.table.change(id, self._named(changed))

    def _check_room(self, record: Order) -> None:
        waiting = [each.client for each in self.known.values() if each.state == "waiting"]
        if len(waiting) >= self.most:
            raise ContainerFull(f"{self.most} orders are waiting, which is as many as may. Try again later.")
        if waiting.count(record.client) >= self.most_of_client:
            raise ContainerFull(
                f"{self.most_of_client} of your orders are waiting, which is as many as one client may have."
                " Withdraw some, or try again later."
            )

    def _named(self, record: Order) -> Order:
        """Return an order with the path of its mission, and a title."""
        base, path = place_of(record.wanted.mission, filter(None, (record.base, *self.core.public_urls)))
        mission = self.targets.missions.get(path.rpartition("/")[2])
        title = record.wanted.title or (mission.title if mission is not None else "Order")
        return replace(record, base=base, mission_path=path, title=title)


def place_of(mission: str, bases: Iterable[str]) -> tuple[str, str]:
    """Return the base URL, one of these, and the path of the IRI of a mission. Raises UnprocessableContent."""
    for base in bases:
        path = path_in_fleet(mission, (base,))
        if path is not None and path.startswith("/missions/"):
            return base, path
    raise UnprocessableContent(f"{mission[:200]} is no mission of this fleet; those are members of /missions.")
