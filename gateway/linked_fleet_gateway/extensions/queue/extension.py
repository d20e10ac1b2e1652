"""The extension ``queue``: orders of missions, which robots take in turn."""

from collections import Counter
from collections.abc import AsyncIterator, Collection, Iterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

from msgspec.structs import replace
from prometheus_client.metrics_core import Metric

from linked_fleet_base.settings import Section, setting, whole_number
from linked_fleet_gateway.api import (
    Container,
    Core,
    Extension,
    Graph,
    Member,
    Mount,
    NavigationEntry,
    Right,
    Table,
    gauge,
    gauges,
)
from linked_fleet_gateway.extensions.missions.runs import Runs
from linked_fleet_gateway.extensions.missions.targets import Targets, creator_of
from linked_fleet_gateway.extensions.query.service import Queries
from linked_fleet_gateway.extensions.queue import schedules
from linked_fleet_gateway.extensions.queue.checking import Checks
from linked_fleet_gateway.extensions.queue.describing import describe_order, order_json
from linked_fleet_gateway.extensions.queue.dispatcher import KEPT, Dispatcher
from linked_fleet_gateway.extensions.queue.handlers import handlers
from linked_fleet_gateway.extensions.queue.needs import Needs, Selections
from linked_fleet_gateway.extensions.queue.order import Assignments, Order
from linked_fleet_gateway.extensions.queue.planned import PlannedWork
from linked_fleet_gateway.extensions.queue.reading import form, read_order
from linked_fleet_gateway.extensions.queue.records import OrderRecords
from linked_fleet_gateway.extensions.queue.schedule import Schedule
from linked_fleet_gateway.extensions.queue.schedules import ScheduleRecords
from linked_fleet_gateway.extensions.queue.starting import Starts
from linked_fleet_gateway.extensions.queue.terms import LF
from linked_fleet_gateway.extensions.queue.timetable import Timetable
from linked_fleet_gateway.faces import Identity, Tree

HERE = Path(__file__).parent


@dataclass(frozen=True)
class QueueSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_QUEUE_"

    most: int = setting(whole_number(1, 5_000), "2000", "orders that wait")
    per_client: int = setting(whole_number(1, 5_000), "200", "orders of one client that wait")
    schedules: int = setting(whole_number(1, 5_000), "500", "schedules")
    schedules_per_client: int = setting(whole_number(1, 5_000), "50", "schedules of one client")
    running: int = setting(whole_number(1, 500), "200", "orders that run at the same time")


class QueueExtension(Extension):
    """Orders at ``/queue``, and schedules that put them there at ``/schedules``."""

    name = "queue"
    at_root = ("queue", "schedules")
    needs = ("query", "rules", "missions", "availability")
    uses = ("latches",)
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    kinds = (HERE / "kinds.ttl",)
    settings = QueueSettings
    navigation = (NavigationEntry("Queue", "/queue", 16),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.queue import page

        return page.VIEWS

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        section = core.section(QueueSettings)
        targets, queries = core.service(Targets), core.service(Queries)
        dispatchers = list[Dispatcher]()

        def changed(id: str, before: Order | None, after: Order | None) -> None:
            if before is None:
                core.live.fan_out.add_resource(f"/queue/{id}")
            core.mark_changed("/queue", f"/queue/{id}")
            for each in dispatchers:
                each.wake()

        def assigned(id: str, before: Assignments | None, after: Assignments | None) -> None:
            for each in dispatchers:
                each.wake()

        table = core.table("orders", Order, changed, section.most + section.running + KEPT * 2)
        given = core.table("assignments", Assignments, assigned, 1)
        async with table, given, Selections(core, targets, queries) as selections:
            needs = Needs(core, targets, selections)
            starts = Starts(core, table, targets)
            records = OrderRecords(core, table, targets, section.most, section.per_client)
            async with Dispatcher(core, table, given, needs, starts, core.service(Runs), section.running) as dispatcher:
                dispatchers.append(dispatcher)
                checks = Checks(core, targets, queries)
                queue = _queue(records, needs, dispatcher, checks)

                def make(kept: Table[Schedule]) -> Container[Schedule]:
                    return schedules.container(ScheduleRecords(core, kept, section.schedules_per_client), checks, needs)

                async with core.open_container("schedules", Schedule, make, section.schedules) as listed:
                    assert isinstance(listed.records, ScheduleRecords)
                    timetable = Timetable(core, listed.records.table, records, partial(_check_start, checks))
                    with core.listening_to_invocations(dispatcher.hear):
                        async with timetable:
                            yield Mount(
                                branches=(queue.branch, listed.branch),
                                handlers=handlers(core, table, needs, dispatcher.wake),
                                metrics=lambda: _metrics(table.known.values(), listed.records.known.values()),
                                services=(PlannedWork(table.known, listed.records.known, needs),),
                            )


async def _check_start(checks: Checks, schedule: Schedule) -> None:
    """Check the order of a schedule with the present rights of who wrote it. Raises FleetError."""
    identity = checks.targets.identity(schedule.creator)
    tree = checks.core.live.tree(schedule.base, identity.visible_robots)
    await checks.check(schedule.planned.order, tree, identity)


def _queue(records: OrderRecords, needs: Needs, dispatcher: Dispatcher, checks: Checks) -> Container[Order]:
    def describe(graph: Graph, member: Member[Order]) -> None:
        describe_order(graph, member.iri, member.record, facts(member))

    def facts(member: Member[Order]) -> str:
        return dispatcher.reason(member.id, member.record)

    async def check(order: Order, tree: Tree, caller: Identity) -> None:
        await checks.check(order.wanted, tree, caller)

    return Container(
        segment="queue", title="Queue", type=LF.Queue, member_type=LF.QueuedOrder, records=records,
        shape=LF.OrderInput, read=read_order, describe=describe, title_of=lambda order: order.title,
        predicate=LF.queue, visible=needs.shows, blueprint=LF.QueueShape, member_blueprint=LF.OrderShape,
        writing=(Right.ACT, Right.ADMIN), form=form, check=check, signed=_signed, facts=facts,
        json=lambda member: order_json(member.id, member.record, facts(member)),
    )  # fmt: skip


def _signed(order: Order, caller: Identity, client: str) -> Order:
    return replace(order, creator=creator_of(caller, client))


def _metrics(orders: Collection[Order], planned: Collection[Schedule]) -> Iterator[Metric]:
    states = Counter(each.state for each in list(orders))
    yield gauges("orders", "Orders of the queue by state.", "state", states.items())
    missed = sum(each.missed_count for each in list(planned))
    yield gauge("schedules", "Schedules that put orders into the queue.", len(planned))
    yield gauge("missed_starts", "Starts of schedules at which no order was put into the queue.", missed)
