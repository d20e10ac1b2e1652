"""The container of schedules: how clients write them, and what is told of them."""

import asyncio
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
from msgspec.structs import replace
from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_gateway.api import (
    DCTERMS,
    Body,
    Conflict,
    Container,
    Core,
    Graph,
    Member,
    Right,
    Table,
    UnprocessableContent,
    integer,
    timestamp,
)
from linked_fleet_gateway.extensions.missions.reading import decoded
from linked_fleet_gateway.extensions.missions.targets import creator_of
from linked_fleet_gateway.extensions.queue import reading
from linked_fleet_gateway.extensions.queue.checking import Checks
from linked_fleet_gateway.extensions.queue.describing import describe_wanted, number
from linked_fleet_gateway.extensions.queue.needs import Needs
from linked_fleet_gateway.extensions.queue.order import Order
from linked_fleet_gateway.extensions.queue.records import place_of
from linked_fleet_gateway.extensions.queue.schedule import Planned, Schedule
from linked_fleet_gateway.extensions.queue.terms import LF
from linked_fleet_gateway.extensions.queue.timetable import AT_ONCE, first_start, recurrence_of
from linked_fleet_gateway.faces import DeclaredForm, Identity, Tree, View
from linked_fleet_rdf.graph import Node


@dataclass(frozen=True)
class ScheduleRecords:
    """The schedules, whose first start is computed when they are written."""

    core: Core
    table: Table[Schedule]
    most_of_client: int

    @property
    def known(self) -> Mapping[str, Schedule]:
        return self.table.known

    async def add(self, record: Schedule) -> str:
        """Add a schedule. Raises UnprocessableContent, Conflict, ContainerFull, RedisUnavailable."""
        if [each.client for each in self.known.values()].count(record.client) >= self.most_of_client:
            raise Conflict(f"You have {self.most_of_client} schedules, which is as many as one client may have.")
        return await self.table.add(await self._started(replace(record, created_ns=time.time_ns())))

    async def change(self, id: str, record: Schedule | None) -> bool:
        """Replace a schedule, or delete it. What it has missed stays. Raises UnprocessableContent, RedisUnavailable."""
        present = self.known.get(id)
        if record is None or present is None:
            return await self.table.change(id, record)
        changed = replace(present, planned=record.planned, title=record.title, creator=record.creator)
        return await self.table.change(id, await self._started(changed))

    async def _started(self, schedule: Schedule) -> Schedule:
        base, _ = place_of(schedule.planned.order.mission, self.core.public_urls)
        found = await asyncio.to_thread(first_start, replace(schedule, base=base), time.time_ns())
        if found is None:
            raise UnprocessableContent(f"The rule has more than {AT_ONCE} starts in the past; let it start later.")
        if not found.next:
            raise UnprocessableContent("The rule has no start from now on.")
        return found


def read_schedule(body: Body) -> Schedule:
    """Return the schedule that a body describes. Raises UnprocessableContent."""
    template = body.node(body.root, LF.orderTemplate)
    assert template is not None
    active = body.text(body.root, LF.isActive)
    said: dict[str, Any] = {
        "order": reading.read_wanted(body, template),
        "rule": body.text(body.root, LF.recurrenceRule),
        "start": body.text(body.root, LF.startsAt),
        "timeZone": body.text(body.root, LF.timeZone),
        "title": body.text(body.root, DCTERMS.title) or "",
        "within": body.number(body.root, LF.startWithin) or 0.0,
        "active": active not in ("false", "0"),
    }
    try:
        planned = msgspec.convert(said, Planned)
    except msgspec.ValidationError as error:
        raise UnprocessableContent(f"The schedule is not usable: {error}") from error
    _check(planned)
    return Schedule(planned, title=planned.title or planned.order.title or "Schedule")


def _check(planned: Planned) -> None:
    reading.check(planned.order)
    if planned.order.deadline:
        raise UnprocessableContent("A schedule has no deadline, but within: seconds after each start.")
    recurrence_of(planned)


def describe_planned(graph: Graph, node: Node, planned: Planned) -> None:
    """Add what a client has said of a schedule, besides its title."""
    template = graph.blank()
    graph.add(node, LF.orderTemplate, template)
    describe_wanted(graph, template, planned.order)
    graph.add(node, LF.recurrenceRule, Literal(planned.rule))
    graph.add(node, LF.startsAt, Literal(planned.start))
    graph.add(node, LF.timeZone, Literal(planned.timeZone))
    graph.add(node, LF.isActive, Literal(planned.active))
    if planned.within:
        graph.add(node, LF.startWithin, number(planned.within))


def describe_schedule(graph: Graph, iri: NamedNode, schedule: Schedule) -> None:
    """Add all statements about a schedule, besides its types and title."""
    describe_planned(graph, iri, schedule.planned)
    base = iri.value.rpartition("/schedules/")[0]
    if schedule.next and schedule.planned.active:
        graph.add(iri, LF.nextStart, timestamp(schedule.next_ns))
    if schedule.last:
        graph.add(iri, LF.lastOrder, NamedNode(f"{base}/queue/{schedule.last}"))
    graph.add(iri, LF.orderedBy, Literal(schedule.client))
    graph.add(iri, DCTERMS.created, timestamp(schedule.created_ns))
    graph.add(iri, LF.missedStarts, integer(schedule.missed_count))
    for each in schedule.missed:
        node = graph.blank(LF.MissedStart)
        graph.add(iri, LF.missedStart, node)
        graph.add(node, LF.startsAt, timestamp(each.at_ns))
        graph.add(node, LF.reason, Literal(each.reason))


def schedule_json(member: Member[Schedule]) -> bytes:
    """Return a schedule in plain JSON."""
    schedule, base = member.record, member.iri.value.rpartition("/schedules/")[0]
    more: dict[str, Any] = {
        "title": schedule.title,
        "next": timestamp(schedule.next_ns).value if schedule.next and schedule.planned.active else "",
        "lastOrder": schedule.last and f"{base}/queue/{schedule.last}",
        "creator": schedule.client,
        "created": timestamp(schedule.created_ns).value,
        "missedStarts": schedule.missed_count,
        "missed": [{"at": timestamp(each.at_ns).value, "reason": each.reason} for each in schedule.missed],
    }
    said = msgspec.to_builtins(schedule.planned) | more
    return json.dumps(said, ensure_ascii=False).encode()


SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["order", "rule", "start", "timeZone"],
    "properties": {
        "title": {"type": "string"},
        "order": reading.SCHEMA,
        "rule": {"type": "string", "description": "an RRULE of iCalendar, such as FREQ=WEEKLY;BYDAY=MO,FR;BYHOUR=9"},
        "start": {"type": "string", "description": "the local time from which the rule counts"},
        "timeZone": {"type": "string", "description": "such as Europe/Berlin"},
        "within": {"type": "number", "minimum": 0, "description": "seconds after a start until which it may begin"},
        "active": {"type": "boolean"},
    },
}
"""The JSON Schema of a schedule."""


def form(iri: str) -> DeclaredForm:
    """Return the JSON form of a schedule."""
    return DeclaredForm(declared=SCHEMA, read=_triples)


def _triples(content: bytes, iri: str, most: int) -> list[Triple]:
    planned = decoded(content, Planned, "schedule", iri)
    _check(planned)
    graph = Graph()
    root = graph.blank()
    if planned.title:
        graph.add(root, DCTERMS.title, Literal(planned.title))
    describe_planned(graph, root, planned)
    return list(graph.triples)


def container(records: ScheduleRecords, checks: Checks, needs: Needs) -> Container[Schedule]:
    """Return the container of schedules."""

    async def check(schedule: Schedule, tree: Tree, caller: Identity) -> None:
        await checks.check(schedule.planned.order, tree, caller)

    def visible(schedule: Schedule, sees: View) -> bool:
        return needs.shows(as_order(schedule), sees)

    def describe(graph: Graph, member: Member[Schedule]) -> None:
        describe_schedule(graph, member.iri, member.record)

    return Container(
        segment="schedules", title="Schedules", type=LF.ScheduleList, member_type=LF.Schedule, records=records,
        shape=LF.ScheduleInput, read=read_schedule, describe=describe, title_of=lambda schedule: schedule.title,
        predicate=LF.schedules, visible=visible, blueprint=LF.ScheduleListShape, member_blueprint=LF.ScheduleShape,
        writing=(Right.ACT, Right.ADMIN), form=form, check=check, signed=_signed, json=schedule_json,
    )  # fmt: skip


def as_order(schedule: Schedule) -> Order:
    """Return the order of a schedule, as it would be put into the queue."""
    base, path = place_of(schedule.planned.order.mission, (schedule.base,))
    return Order(schedule.planned.order, base=base, mission_path=path, creator=schedule.creator)


def _signed(schedule: Schedule, caller: Identity, client: str) -> Schedule:
    return replace(schedule, creator=creator_of(caller, client))
