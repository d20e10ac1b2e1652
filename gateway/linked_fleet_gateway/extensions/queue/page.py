"""The pages of the queue: the orders in their turn, one order, the schedules, and one of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, NamedNode

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.api import DCTERMS, LDP, Right
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value, say
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_gateway.extensions.queue.terms import LF
from linked_fleet_rdf.vocabulary import HYBRIT, PROV

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.pages import form
else:
    form = LazyModule("linked_fleet_gateway.extensions.pages.form")

_TEMPLATES = Path(__file__).parent / "templates"
_LATEST = 50
"""Orders that are over and shown in the list."""


@dataclass(frozen=True)
class Row:
    """An order in a list."""

    link: Link
    state: Value | None
    reason: str
    priority: int
    rank: float
    client: str
    created: Value | None
    when: Value | None
    robots: list[Link]
    run: Link | None


def queue(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    waiting = sorted(_rows(facts, members, LF.waiting), key=lambda row: (-row.priority, row.rank, str(row.created)))
    running = _rows(facts, members, LF.starting, LF.running)
    over = _rows(facts, members, LF.succeeded, LF.failed, LF.cancelled, LF.missed)
    latest = sorted(over, key=lambda row: str(row.when), reverse=True)[:_LATEST]
    made = form.form_of_shape(LF.OrderInput, iri.value, "POST", say("Put into the queue"), facts, iri, Right.ACT)
    return Part({"waiting": waiting, "running": running, "over": latest, "form": made}, {LDP.contains}, {*members})


def _rows(facts: Facts, members: Sequence[NamedNode], *states: NamedNode) -> list[Row]:
    return [_row(facts, each) for each in members if facts.one(each, LF.state) in states]


def _row(facts: Facts, iri: NamedNode) -> Row:
    run = facts.one(iri, LF.missionRun)
    return Row(
        facts.link(iri),
        facts.first_value(iri, LF.state),
        facts.text(iri, LF.reason),
        int(facts.text(iri, LF.priority) or 0),
        float(facts.text(iri, LF.rank) or 0),
        facts.text(iri, LF.orderedBy),
        facts.first_value(iri, DCTERMS.created),
        facts.first_value(iri, PROV.endedAtTime),
        [facts.link(each) for each in facts.nodes(iri, LF.reservedRobot)],
        facts.link(run) if isinstance(run, NamedNode) else None,
    )


def order(facts: Facts, iri: NamedNode) -> Part:
    actions = [facts.link(each) for each in facts.nodes(iri, HYBRIT.action)]
    more = {"order": _row(facts, iri), "actions": actions}
    return Part(more, {LF.state, LF.reason, LF.reservedRobot, LF.missionRun, HYBRIT.action})


@dataclass(frozen=True)
class ScheduleRow:
    """A schedule in a list."""

    link: Link
    rule: str
    zone: str
    next: Value | None
    missed: str


@dataclass(frozen=True)
class MissedRow:
    """A start that was missed."""

    at: Value | None
    reason: str


def schedules(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    rows = sorted((_schedule(facts, each) for each in members), key=lambda row: row.link.text)
    return Part({"schedules": rows}, {LDP.contains}, {*members})


def _schedule(facts: Facts, iri: NamedNode) -> ScheduleRow:
    return ScheduleRow(
        facts.link(iri),
        facts.text(iri, LF.recurrenceRule),
        facts.text(iri, LF.timeZone),
        facts.first_value(iri, LF.nextStart),
        facts.text(iri, LF.missedStarts),
    )


def schedule(facts: Facts, iri: NamedNode) -> Part:
    nodes = [each for each in facts.all(iri, LF.missedStart) if isinstance(each, BlankNode)]
    missed = [MissedRow(facts.first_value(each, LF.startsAt), facts.text(each, LF.reason)) for each in nodes]
    latest = sorted(missed, key=lambda row: str(row.at), reverse=True)
    more = {"schedule": _schedule(facts, iri), "missed": latest}
    return Part(more, {LF.missedStart, LF.nextStart, LF.recurrenceRule, LF.timeZone})


VIEWS = (
    PageView(
        LF.ScheduleList,
        _TEMPLATES / "schedules.html",
        schedules,
        help=message("Missions that begin by themselves at set times."),
        guide="docs/MAP.md",
    ),
    PageView(
        LF.Schedule,
        _TEMPLATES / "schedule.html",
        schedule,
        help=message("When a mission begins by itself, and which starts were missed."),
        guide="docs/MAP.md",
    ),
    PageView(
        LF.Queue,
        _TEMPLATES / "queue.html",
        queue,
        help=message(
            "Missions that wait for free robots. Put one in, or change the order; the first one that can run is"
            " started."
        ),
        guide="docs/MAP.md",
    ),
    PageView(
        LF.QueuedOrder,
        _TEMPLATES / "queued_order.html",
        order,
        help=message("One mission in the queue: why it waits, or which robots carry it out."),
        guide="docs/MAP.md",
    ),
)
