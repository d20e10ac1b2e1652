"""Orders as triples and in JSON. Pure."""

import json
from collections.abc import Mapping
from typing import Any

import msgspec
from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import DCTERMS, METRE, Graph, integer, robot_path, timestamp
from linked_fleet_gateway.extensions.missions.terms import JSON
from linked_fleet_gateway.extensions.queue.order import Choice, Order, Wanted
from linked_fleet_gateway.extensions.queue.terms import LF
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.vocabulary import MATHS, PROV, VOM, XSD


def describe_wanted(graph: Graph, node: Node, wanted: Wanted) -> None:
    """Add what a client has said of an order."""
    graph.add(node, LF.mission, NamedNode(wanted.mission))
    if wanted.title:
        graph.add(node, DCTERMS.title, Literal(wanted.title))
    if wanted.input:
        graph.add(node, LF.input, json_literal(wanted.input))
    if wanted.battery:
        graph.add(node, LF.batteryNeed, number(wanted.battery))
    graph.add(node, LF.priority, integer(wanted.priority))
    if wanted.deadline:
        graph.add(node, LF.deadline, Literal(wanted.deadline, datatype=XSD.dateTime))
    if wanted.choice is not None:
        graph.add(node, LF.choice, _describe_choice(graph, wanted.choice))


def _describe_choice(graph: Graph, choice: Choice) -> Node:
    node = graph.blank(LF.RobotChoice)
    graph.add(node, LF.forParameter, Literal(choice.parameter))
    graph.add(node, LF.candidate, *map(NamedNode, choice.robots))
    for predicate, iri in ((LF.componentKind, choice.kind), (LF.offersKind, choice.offers)):
        if iri:
            graph.add(node, predicate, NamedNode(iri))
    if choice.select:
        graph.add(node, LF.select, Literal(choice.select))
    if choice.near is not None:
        point = graph.blank()
        graph.add(node, LF.nearPoint, point)
        graph.add(point, MATHS.x, number(choice.near.x))
        graph.add(point, MATHS.y, number(choice.near.y))
        graph.add(point, VOM.unit, METRE.vom)
    return node


def json_literal(value: Mapping[str, Any]) -> Literal:
    """Return a JSON object as a literal."""
    return Literal(json.dumps(value, ensure_ascii=False, sort_keys=True), datatype=NamedNode(JSON))


def number(value: float) -> Literal:
    """Return a number as a literal."""
    return Literal(repr(float(value)), datatype=XSD.double)


def describe_order(graph: Graph, iri: NamedNode, order: Order, reason: str) -> None:
    """Add all statements about an order, besides its types and title. ``reason`` says why it waits, or has ended."""
    describe_wanted(graph, iri, msgspec.structs.replace(order.wanted, title=""))
    graph.add(iri, LF.state, LF.terms[order.state])
    if reason:
        graph.add(iri, LF.reason, Literal(reason))
    graph.add(iri, LF.rank, number(order.rank))
    graph.add(iri, LF.attempt, integer(order.attempt))
    graph.add(iri, DCTERMS.created, timestamp(order.created_ns))
    graph.add(iri, LF.orderedBy, Literal(order.client))
    graph.add(iri, LF.reservedRobot, *(NamedNode(order.base + robot_path(each)) for each in order.robots))
    if order.schedule:
        graph.add(iri, LF.fromSchedule, NamedNode(order.base + order.schedule))
    if order.run:
        graph.add(iri, LF.missionRun, NamedNode(f"{order.base}/mission-runs/{order.run}"))
    for predicate, at_ns in ((PROV.startedAtTime, order.began_ns), (PROV.endedAtTime, order.ended_ns)):
        if at_ns:
            graph.add(iri, predicate, timestamp(at_ns))
    for text in order.notes:
        graph.add(iri, LF.note, Literal(text))


def order_json(id: str, order: Order, reason: str) -> bytes:
    """Return an order in plain JSON: what its client said, and what has become of it."""
    said: dict[str, Any] = msgspec.to_builtins(order.wanted)
    more: dict[str, Any] = {
        "title": order.title,
        "state": order.state,
        "reason": reason,
        "priority": order.wanted.priority,
        "rank": order.rank,
        "attempt": order.attempt,
        "creator": order.client,
        "created": timestamp(order.created_ns).value,
        "schedule": order.schedule and order.base + order.schedule,
        "robots": [order.base + robot_path(each) for each in order.robots],
        "run": order.run and f"{order.base}/mission-runs/{order.run}",
        "started": order.began_ns and timestamp(order.began_ns).value,
        "ended": order.ended_ns and timestamp(order.ended_ns).value,
        "notes": list(order.notes),
    }
    kept = ("state", "priority", "rank", "attempt")
    said |= {name: value for name, value in more.items() if value or name in kept}
    return json.dumps(said, ensure_ascii=False).encode()
