"""Properties and events of components as properties of a part."""

from collections.abc import Iterator
from typing import Any

import msgspec
from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.declaration import Event
from linked_fleet_agent.wire.schema import Schema
from linked_fleet_gateway.extensions.components.component import DeclaredComponent
from linked_fleet_gateway.extensions.components.declarations import CompiledEvent, CompiledProperty
from linked_fleet_gateway.extensions.components.shapes import SH
from linked_fleet_gateway.extensions.components.state import Happened
from linked_fleet_gateway.extensions.components.terms import LF
from linked_fleet_gateway.extensions.components.units import declared_unit
from linked_fleet_gateway.extensions.components.values import add_value, has_more_values
from linked_fleet_gateway.faces import DeclaredForm, Json, Measurement, Offer, Property
from linked_fleet_rdf.graph import Graph, integer, moment, timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, SOSA, XSD
from linked_fleet_state.observation import Observation

_TIME: Json = {"type": "string", "format": "date-time"}
_MOST_AT_ONCE = 200
"""Values in a value that are described at once, in a few milliseconds."""
_UNKNOWN = Observation((float("nan"),), None)


def schema_json(schema: Schema) -> Json:
    """Return a declared schema as JSON."""
    found: Json = msgspec.to_builtins(schema)
    return found


def or_null(schema: Json) -> Json:
    """Return the schema of a value that may be unknown."""
    return {"oneOf": [schema, {"type": "null"}]}


def property_item(
    part: DeclaredComponent, name: str, segment: str, compiled: CompiledProperty, put: Offer | None, base: str
) -> Property:
    """Return a property of a component. The value of one that is a number is an observation."""
    schema, iri = compiled.declared.schema, f"{base}{part.path}/{segment}"
    is_number = schema.type == "number"

    def describe(graph: Graph, node: NamedNode, seen: Measurement) -> None:
        graph.add(node, DCTERMS.identifier, Literal(name))
        if is_number:
            graph.scalar(node, LF.value, seen.values[0], declared_unit(schema))
            graph.result_time(node, seen.wall_ns)
        else:
            known = part.is_current
            compiled.describe(graph, node, part.state.value(name) if known else None)
            graph.result_time(node, part.state.times_ns.get(name) if known else None)

    def steps(graph: Graph, node: NamedNode) -> Iterator[None]:
        graph.add(node, DCTERMS.identifier, Literal(name))
        value, wall_ns = part.state.value(name), part.state.times_ns.get(name)
        yield from compiled.describe_in_steps(graph, node, value)
        graph.result_time(node, wall_ns)

    def is_long() -> bool:
        return part.is_current and has_more_values(part.state.value(name), _MOST_AT_ONCE)

    def sample() -> tuple[Observation, ...]:
        return (part.state.observation(name) if part.is_current else _UNKNOWN,)

    def facts() -> object:
        if is_number:
            return compiled.declared
        known = part.is_current
        value = msgspec.json.encode(part.state.value(name)) if known else b""
        return compiled.declared, value, part.state.times_ns.get(name) if known else None

    return Property(
        segment,
        compiled.predicate,
        (LF.ComponentProperty,),
        NamedNode(f"{iri}/blueprint#shape"),
        f"{schema.title or name} of {part.title}",
        describe,
        sample if is_number else tuple,
        facts,
        put,
        counter=lambda: part.state.counters.get(name, 0) if part.is_current else 0,
        form=_form(schema_json(schema), schema.unit),
        json=lambda: _json(part, name, schema.unit),
        describe_shapes=lambda graph: _describe_shapes(graph, compiled, iri, put is not None),
        steps=steps,
        is_long=is_long,
    )


def _form(schema: Json, unit: str) -> DeclaredForm:
    members: Json = {"value": or_null(schema), "resultTime": or_null(_TIME)}
    if unit:
        members["unit"] = {"type": "string", "const": unit}
    return DeclaredForm(declared={"type": "object", "properties": members, "required": list(members)})


def _json(part: DeclaredComponent, name: str, unit: str) -> bytes:
    known = part.is_current
    wall_ns = part.state.times_ns.get(name) if known else None
    said: Json = {
        "value": part.state.value(name) if known else None,
        "resultTime": None if wall_ns is None else timestamp(wall_ns).value,
    }
    return msgspec.json.encode(said | ({"unit": unit} if unit else {}))


def _describe_shapes(graph: Graph, compiled: CompiledProperty, iri: str, writable: bool) -> None:
    shape = NamedNode(f"{iri}/blueprint#shape")
    graph.a(shape, SH.NodeShape)
    compiled.describe_shape(graph, shape)
    if writable:
        compiled.input.describe_shape(graph, NamedNode(f"{iri}/blueprint#input"))


def event_item(part: DeclaredComponent, name: str, segment: str, compiled: CompiledEvent, base: str) -> Property:
    """Return an event of a component: its last occurrence, and their number. Each one is a change."""
    declared, iri = compiled.declared, f"{base}{part.path}/{segment}"

    def happened() -> Any:
        return part.state.events.get(name) if part.is_current else None

    def describe(graph: Graph, node: NamedNode, _: Measurement) -> None:
        last = happened()
        graph.add(node, DCTERMS.identifier, Literal(name))
        graph.add(node, LF.occurrences, integer(0 if last is None else last.count))
        graph.add(node, SOSA.resultTime, moment(None if last is None else last.wall_ns))
        if last is not None and compiled.data is not None:
            add_value(graph, compiled.data, last.data, node, LF.value)

    def write() -> bytes:
        return msgspec.json.encode({"occurrences": 0, "resultTime": None} | event_members(declared, happened()))

    members = event_schemas(declared) | {"resultTime": or_null(_TIME)}
    return Property(
        segment,
        NamedNode(compiled.term),
        (LF.ComponentEvent, *((NamedNode(declared.semantic_type),) if declared.semantic_type else ())),
        NamedNode(f"{iri}/blueprint#shape"),
        f"{declared.title or name} of {part.title}",
        describe,
        facts=lambda: (declared, happened()),
        counter=lambda: 0 if (last := happened()) is None else last.count,
        form=DeclaredForm(
            declared={"type": "object", "properties": members, "required": ["occurrences", "resultTime"]}
        ),
        json=write,
        describe_shapes=lambda graph: _describe_event_shape(graph, NamedNode(f"{iri}/blueprint#shape")),
    )


def event_schemas(declared: Event) -> Json:
    """Return the schemas of the members that an event has in JSON, by name."""
    found: Json = {"occurrences": {"type": "integer", "minimum": 0}, "resultTime": _TIME}
    return found if declared.data is None else found | {"value": schema_json(declared.data)}


def event_members(declared: Event, last: Happened | None) -> Json:
    """Return what is known of the last occurrence of an event in JSON, by name."""
    if last is None:
        return {"occurrences": 0}
    said = {"occurrences": last.count, "resultTime": timestamp(last.wall_ns).value}
    return said if declared.data is None else said | {"value": last.data}


def _describe_event_shape(graph: Graph, shape: NamedNode) -> None:
    graph.a(shape, SH.NodeShape)
    count = graph.blank()
    graph.add(shape, SH.property, count)
    graph.add(count, SH.path, LF.occurrences)
    graph.add(count, SH.datatype, XSD.integer)
    graph.add(count, SH.minCount, integer(1))
    graph.add(count, SH.maxCount, integer(1))
