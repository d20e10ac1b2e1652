"""A timeline as triples, in plain JSON and as CSV. Pure."""

import json
from collections.abc import Iterator, Sequence, Set

from pyoxigraph import Literal, NamedNode

from linked_fleet_base.spreadsheet import csv_table
from linked_fleet_gateway.api import DCTERMS, RDFS, Graph, integer, robot_path, timestamp
from linked_fleet_gateway.extensions.timeline.activity import Activity
from linked_fleet_gateway.extensions.timeline.collecting import Chronicle
from linked_fleet_gateway.extensions.timeline.terms import LF, state_term
from linked_fleet_gateway.extensions.timeline.window import lexical
from linked_fleet_rdf.vocabulary import HYBRIT, PROV

PATH = "/timeline"
MOST_ROBOTS = 200
"""Robots that are named although they have done nothing, those that have among them."""
_COLUMNS = ("begin", "end", "planned", "latest start", "kind", "title", "state", "who", "robots", "address")


def steps(graph: Graph, base: str, found: Chronicle, robots: Sequence[str]) -> Iterator[None]:
    """Describe a timeline, one activity in each step. ``robots`` are those that the caller sees."""
    iri, window = NamedNode(base + PATH), found.window
    graph.a(iri, LF.Timeline)
    graph.add(iri, DCTERMS.title, Literal("Timeline"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + "/"))
    graph.add(iri, HYBRIT.blueprint, LF.TimelineShape, NamedNode(iri.value + "/blueprint"))
    graph.add(iri, LF.windowStart, timestamp(window.from_ns))
    graph.add(iri, LF.windowEnd, timestamp(window.until_ns))
    graph.add(iri, LF.asOf, timestamp(found.now_ns))
    graph.add(iri, LF.leftOut, integer(found.left_out))
    graph.add(iri, LF.completeFrom, timestamp(found.complete_ns))
    graph.add(iri, LF.completeUntil, timestamp(found.planned_ns))
    if window.robot:
        graph.add(iri, LF.ofRobot, NamedNode(base + robot_path(window.robot)))
    shown = shown_robots(found, robots)
    graph.add(iri, LF.shownRobot, *(NamedNode(base + robot_path(each)) for each in shown))
    graph.add(iri, LF.robotsLeftOut, integer(0 if window.robot else len(robots) - len(shown)))
    yield
    known = frozenset(robots)
    for each in found.activities:
        one = NamedNode(f"{iri.value}#{each.id}")
        graph.add(iri, LF.activity, one)
        _describe_activity(graph, base, one, each, known)
        yield


def shown_robots(found: Chronicle, robots: Sequence[str]) -> list[str]:
    """Return the robots that have a row: those that do something, and others while there are few."""
    if found.window.robot:
        return [found.window.robot]
    busy = {robot for each in found.activities for robot in each.robots}
    idle = [each for each in robots if each not in busy]
    chosen = busy.union(idle[: max(0, MOST_ROBOTS - len(busy))])
    return [each for each in robots if each in chosen]


def _describe_activity(graph: Graph, base: str, iri: NamedNode, activity: Activity, known: Set[str]) -> None:
    """Describe an activity, with those of its robots that are there."""
    graph.a(iri, PROV.Activity, LF.TimelineActivity)
    graph.add(iri, DCTERMS.title, Literal(activity.title))
    graph.add(iri, LF.activityKind, Literal(activity.kind))
    graph.add(iri, LF.activityOf, NamedNode(base + activity.path))
    graph.add(iri, LF.state, state_term(activity.state))
    graph.add(iri, _begin_predicate(activity), timestamp(activity.begin_ns))
    if activity.end_ns is not None and not activity.planned:
        graph.add(iri, PROV.endedAtTime, timestamp(activity.end_ns))
    if activity.latest_ns is not None:
        graph.add(iri, LF.latestStart, timestamp(activity.latest_ns))
    if activity.who:
        agent = graph.blank(PROV.Agent)
        graph.add(iri, PROV.wasAssociatedWith, agent)
        graph.add(agent, DCTERMS.title, Literal(activity.who))
    graph.add(iri, LF.ofRobot, *(NamedNode(base + robot_path(each)) for each in activity.robots if each in known))


def _begin_predicate(activity: Activity) -> NamedNode:
    """Return the predicate of its beginning: what waits for its turn was created, and has no time to begin."""
    if not activity.planned:
        return PROV.startedAtTime
    return LF.plannedStart if activity.kind == "schedule" else DCTERMS.created


# -- plain JSON and CSV -----------------------------------------------------------------------------------------------


def timeline_json(base: str, found: Chronicle, robots: Sequence[str]) -> bytes:
    """Return a timeline in plain JSON."""
    known = frozenset(robots)
    told = {
        "from": lexical(found.window.from_ns),
        "until": lexical(found.window.until_ns),
        "now": lexical(found.now_ns),
        "leftOut": found.left_out,
        "completeFrom": lexical(found.complete_ns),
        "completeUntil": lexical(found.planned_ns),
        "activities": [_activity_json(base, each, known) for each in found.activities],
    }
    return json.dumps(told, ensure_ascii=False).encode()


def _activity_json(base: str, activity: Activity, known: Set[str]) -> dict[str, object]:
    told: dict[str, object] = {
        "kind": activity.kind,
        "title": activity.title,
        "state": activity.state,
        "planned": activity.planned,
        "begin": lexical(activity.begin_ns),
        "of": base + activity.path,
        "robots": [base + robot_path(each) for each in activity.robots if each in known],
    }
    more = {"end": _end(activity), "latestStart": _time(activity.latest_ns), "who": activity.who}
    return told | {name: value for name, value in more.items() if value}


def _end(activity: Activity) -> str:
    return "" if activity.planned else _time(activity.end_ns)


def _time(stamp_ns: int | None) -> str:
    return "" if stamp_ns is None else lexical(stamp_ns)


def timeline_csv(base: str, found: Chronicle) -> bytes:
    """Return a timeline as CSV (RFC 4180), one activity in each line."""
    return csv_table(_COLUMNS, (_line(base, each) for each in found.activities))


def _line(base: str, activity: Activity) -> tuple[str, ...]:
    begin, latest = lexical(activity.begin_ns), _time(activity.latest_ns)
    planned, robots = "yes" if activity.planned else "no", "; ".join(activity.robots)
    return (
        begin, _end(activity), planned, latest, activity.kind, activity.title, activity.state, activity.who, robots,
        base + activity.path,
    )  # fmt: skip
