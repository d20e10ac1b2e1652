"""Orders from triples and from JSON, and what no shape can say of them. Pure."""

import json
from datetime import UTC, datetime
from typing import Any

import msgspec
from pyoxigraph import NamedNode, Triple

from linked_fleet_gateway.api import DCTERMS, Body, Graph, UnprocessableContent
from linked_fleet_gateway.extensions.missions.reading import decoded
from linked_fleet_gateway.extensions.queue.describing import describe_wanted
from linked_fleet_gateway.extensions.queue.order import Choice, Order, Wanted
from linked_fleet_gateway.extensions.queue.terms import LF
from linked_fleet_gateway.faces import DeclaredForm
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.vocabulary import MATHS

_YEARS = 1970, 2200


def read_order(body: Body) -> Order:
    """Return the order that a body describes. Raises UnprocessableContent."""
    return Order(read_wanted(body, body.root))


def read_wanted(body: Body, node: Node) -> Wanted:
    """Return what a node of a body wants. Raises UnprocessableContent."""
    said: dict[str, Any] = {
        "mission": _iri(body, node, LF.mission),
        "title": body.text(node, DCTERMS.title) or "",
        "input": _input(body, node),
        "battery": body.number(node, LF.batteryNeed) or 0.0,
        "priority": int(body.number(node, LF.priority) or 0),
        "deadline": body.text(node, LF.deadline) or "",
    }
    if (choice := body.node(node, LF.choice)) is not None:
        said["choice"] = _choice(body, choice)
    try:
        wanted = msgspec.convert(said, Wanted)
    except msgspec.ValidationError as error:
        raise UnprocessableContent(f"The order is not usable: {error}") from error
    check(wanted)
    return wanted


def _input(body: Body, node: Node) -> dict[str, Any]:
    text = body.text(node, LF.input)
    try:
        found = json.loads(text) if text else {}
    except (ValueError, RecursionError) as error:
        raise UnprocessableContent(f"lf:input is no JSON: {error}") from error
    if not isinstance(found, dict):
        raise UnprocessableContent('lf:input is a JSON object with values of parameters, such as {"angle": 0.2}.')
    return found


def _choice(body: Body, node: Node) -> dict[str, Any]:
    said: dict[str, Any] = {
        "parameter": body.text(node, LF.forParameter),
        "robots": sorted(each.value for each in body.nodes(node, LF.candidate)),
        "kind": _iri(body, node, LF.componentKind),
        "offers": _iri(body, node, LF.offersKind),
        "select": body.text(node, LF.select) or "",
    }
    if (point := body.node(node, LF.nearPoint)) is not None:
        scale = body.unit(point)
        said["near"] = {name: (body.number(point, MATHS.terms[name]) or 0.0) * scale for name in ("x", "y")}
    return said


def _iri(body: Body, node: Node, predicate: NamedNode) -> str:
    found = body.node(node, predicate)
    return found.value if isinstance(found, NamedNode) else ""


def check(wanted: Wanted) -> None:
    """Raise UnprocessableContent for an order that could not run, whatever the fleet is."""
    for iri in (wanted.mission, *_iris(wanted.choice)):
        try:
            NamedNode(iri)
        except ValueError as error:
            raise UnprocessableContent(f"The order names {iri[:100]!r}, which is no IRI: {error}.") from error
    if wanted.deadline:
        deadline_ns(wanted)
    choice = wanted.choice
    if choice is None:
        return
    if not (choice.robots or choice.kind or choice.offers or choice.select):
        raise UnprocessableContent(
            "A choice says which robots can: robots, the kind of a component, the kind of an action that they offer,"
            " or a SPARQL SELECT."
        )
    if choice.parameter in wanted.input:
        raise UnprocessableContent(f"The parameter {choice.parameter} has either a value, or a choice.")


def _iris(choice: Choice | None) -> list[str]:
    return [] if choice is None else [*choice.robots, *filter(None, (choice.kind, choice.offers))]


def deadline_ns(wanted: Wanted) -> int:
    """Return the deadline in wall nanoseconds; 0 if there is none. Raises UnprocessableContent."""
    if not wanted.deadline:
        return 0
    try:
        instant = datetime.fromisoformat(wanted.deadline)
    except ValueError as error:
        raise UnprocessableContent(
            f"deadline is an xsd:dateTime, such as 2026-11-29T20:00:00Z, not {wanted.deadline[:40]!r}."
        ) from error
    if instant.tzinfo is None:
        raise UnprocessableContent("The deadline has a time zone, such as Z in 2026-11-29T20:00:00Z.")
    if not _YEARS[0] <= instant.year <= _YEARS[1]:
        raise UnprocessableContent(f"The deadline is an instant of the years {_YEARS[0]} to {_YEARS[1]}.")
    return int(instant.astimezone(UTC).timestamp() * 1e9)


# -- JSON -------------------------------------------------------------------------------------------------------------

CHOICE_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["parameter"],
    "description": "which robots may be the value of a parameter; what is given must all be true of a robot",
    "properties": {
        "parameter": {"type": "string"},
        "robots": {"type": "array", "items": {"type": "string", "format": "uri"}},
        "kind": {"type": "string", "format": "uri", "description": "the class of a component that it has"},
        "offers": {"type": "string", "format": "uri", "description": "the kind of an action that it offers"},
        "select": {"type": "string", "description": "a SPARQL SELECT, whose first variable is bound to robots"},
        "near": {
            "type": "object",
            "required": ["x", "y"],
            "description": "a point of the world in metre; the nearest free robot is taken",
            "properties": {"x": {"type": "number"}, "y": {"type": "number"}},
        },
    },
}
SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["mission"],
    "properties": {
        "mission": {"type": "string", "format": "uri"},
        "title": {"type": "string"},
        "input": {"type": "object", "description": "values of the parameters of the mission"},
        "choice": CHOICE_SCHEMA,
        "battery": {"type": "number", "minimum": 0, "maximum": 100, "description": "least charge of robots, percent"},
        "priority": {"type": "integer", "minimum": -100, "maximum": 100},
        "deadline": {"type": "string", "format": "date-time", "description": "until when it may begin"},
    },
}
"""The JSON Schema of an order."""


def form(iri: str) -> DeclaredForm:
    """Return the JSON form of an order."""
    return DeclaredForm(declared=SCHEMA, read=_triples)


def _triples(content: bytes, iri: str, most: int) -> list[Triple]:
    wanted = decoded(content, Wanted, "order", iri)
    check(wanted)
    graph = Graph()
    describe_wanted(graph, graph.blank(), wanted)
    return list(graph.triples)
