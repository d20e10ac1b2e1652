"""The actions of components, and the setting of their properties, as actions of a part."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_agent.wire.components import MAX_INPUT_BYTES, Action, StreamLimits
from linked_fleet_agent.wire.keys import escape
from linked_fleet_agent.wire.messages import StreamCounts
from linked_fleet_base.errors import BadRequest, PayloadTooLarge, UnprocessableContent
from linked_fleet_gateway.extensions.components.component import DeclaredComponent
from linked_fleet_gateway.extensions.components.declarations import Input
from linked_fleet_gateway.extensions.components.items import schema_json
from linked_fleet_gateway.extensions.components.shapes import ShapeWriter
from linked_fleet_gateway.extensions.components.terms import LF
from linked_fleet_gateway.faces import (
    ActionDefinition,
    Body,
    DeclaredForm,
    Form,
    Json,
    Offer,
    Right,
    action_definitions,
)
from linked_fleet_rdf.graph import SECOND, Graph, Node
from linked_fleet_rdf.json_input import ParseError, load_json
from linked_fleet_rdf.validation import find_root, refuse_statements
from linked_fleet_rdf.vocabulary import LDP, METHODS

_RESET = LF.extended("ResetProtectiveStop").ResetProtectiveStop
"""The kind of action that lets a robot move again after a protective stop."""


_MAX_DEPTH = 16
"""More than any schema has, whose depth is 4: what is nested less is refused by the shape, which says where."""
_VALUES = 2  # JSON values for each permitted triple
_SAMPLES: Json = {
    "type": "object",
    "description": "What became of the samples of a stream.",
    "properties": {
        each.name: {"type": "boolean"} if each.type is bool else {"type": "integer", "minimum": 0}
        for each in msgspec.structs.fields(StreamCounts)
    },
}


Handle = Callable[["ComponentOffer", Any], Any]
"""Returns the plan of an action for a request to it."""


class InputBody(Body):
    """A validated body, with its JSON value."""

    def __init__(self, triples: Sequence[Triple], root: Node, value: Any) -> None:
        super().__init__(triples, root)
        self.value = value


@dataclass(frozen=True)
class ComponentOffer(Offer):
    """An action of a component, or the setting of a property."""

    part: DeclaredComponent = field(kw_only=True)
    of_action: str = ""
    of_property: str = ""

    @property
    def name(self) -> str:
        return f"{self.definition.title}: {self.part.title}"

    @property
    def values(self) -> tuple[Literal, ...]:
        return (Literal(self.name),)

    @property
    def template_key(self) -> object:
        return None

    @property
    def needs(self) -> tuple[Right, ...]:
        return (Right.RESET,) if self.definition.iri == _RESET else super().needs

    @property
    def declared_by(self) -> str:
        return self.thing

    @property
    def takes_value(self) -> bool:
        return bool(self.of_property)

    @property
    def declared(self) -> Action | None:
        return self.part.declared.actions.get(self.of_action)

    @property
    def outcome_members(self) -> Mapping[str, Json]:
        declared = self.declared
        if declared is None:
            return {}
        stated = {"feedback": declared.feedback, "output": declared.result}
        found = {name: schema_json(each) for name, each in stated.items() if each is not None}
        return found if declared.stream is None else found | {"samples": _SAMPLES}

    @property
    def stream_protocol(self) -> str:
        declared = self.declared
        return "" if declared is None or declared.stream is None else "lf.drive"

    def input(self, base: str) -> Input:
        """Return what its body must be."""
        compiled = self.part.compiled(base)
        return (
            compiled.properties[self.of_property].input if self.of_property else compiled.actions[self.of_action].input
        )

    def first_body_is_slow(self, base: str) -> bool:
        return not self.input(base).is_compiled

    def describe_at(self, graph: Graph, base: str, thing: str, values: Sequence[Literal]) -> None:
        super().describe_at(graph, base, thing, values)
        iri = NamedNode(base + self.path_at(thing))
        if (declared := self.declared) is not None:
            graph.add(iri, LF.moves, *self.part.moved(self.of_action, base))
            graph.scalar(iri, LF.duration, declared.duration_s, SECOND)
            graph.scalar(iri, LF.stopTime, declared.stop_s, SECOND)
            _describe_stream(graph, iri, self.stream_protocol, declared.stream)

    def describe_result(self, graph: Graph, base: str, thing: str, title: Literal) -> None:
        """Describe the invocation with its feedback and its result, by the names of their JSON form."""
        super().describe_result(graph, base, thing, title)
        if not self.of_action:
            return
        shape = NamedNode(f"{base}{self.path_at(thing)}/produceshape")
        compiled, writer = self.part.compiled(base).actions[self.of_action], ShapeWriter(graph, of_output=True)
        for predicate, name, place in (
            (LF.feedback, "feedback", compiled.feedback),
            (LF.output, "output", compiled.result),
        ):
            if place is not None:
                writer.part_shape(shape, predicate, name, place)

    def _consumes(self, graph: Graph, base: str, numbers: Iterable[Literal]) -> Node:
        node = graph.blank()
        self.input(base).describe_shape(graph, node)
        return node

    @property
    def body_is_optional(self) -> bool:
        declared = self.declared
        return declared is not None and declared.input is not None and not declared.input.required

    def input_form(self, base: str) -> Form | None:
        if self.of_property:
            schema = schema_json(self.part.declared.properties[self.of_property].schema)
            said = {"type": "object", "properties": {"value": schema}, "required": ["value"]}
        else:
            declared = self.declared
            said = schema_json(declared.input) if declared is not None and declared.input is not None else {}
            said = {"type": "object", **said}

        def read(body: bytes, iri: str, most: int) -> list[Triple]:
            return self._triples(body, base, most)

        return DeclaredForm(declared=said, read=read)

    def _triples(self, body: bytes, base: str, most: int) -> list[Triple]:
        given = read_json(body, most)
        if not isinstance(given, dict):
            raise UnprocessableContent("The body is a JSON object.", constraint=base + self.path)
        graph, root, taken = Graph(), BlankNode("root"), self.input(base)
        known = ("value",) if self.of_property else tuple(taken.place.members)
        if unknown := [each for each in given if each not in known]:
            raise UnprocessableContent(
                f"{unknown[0][:100]} is not known; there are {', '.join(known) or 'none'}.", constraint=base + self.path
            )
        if self.of_property and not given:
            raise UnprocessableContent("The body has one member: value.", constraint=base + self.path)
        if not self.of_property:
            graph.a(root, LDP.Resource)  # which says nothing, so that an object without members has a root too
        taken.describe(graph, root, given["value"] if self.of_property else given)
        return graph.triples

    def read_body(self, triples: Sequence[Triple], base: str) -> Body:
        iri = base + self.path
        focus = find_root(triples, NamedNode(iri))
        taken = self.input(base)
        value, refused = taken.read(triples, focus)
        if refused is not None:
            detail, report = refused
            raise UnprocessableContent(
                f"The body does not conform to the shape of the action: {detail}", report=report, constraint=iri
            )
        refuse_statements(taken.unused(triples, focus), iri)
        return InputBody(triples, focus, value)


def read_json(body: bytes, most: int) -> Any:
    """Return the JSON of an input, for ``most`` triples. Raises BadRequest and PayloadTooLarge."""
    if len(body) > MAX_INPUT_BYTES:
        raise PayloadTooLarge(f"The input has {len(body)} bytes; at most {MAX_INPUT_BYTES} are taken.")
    try:
        return load_json(body.decode("utf-8-sig"), _MAX_DEPTH, _VALUES * most)
    except ParseError as error:
        raise BadRequest(f"The body is no JSON: {error}", line=error.line, column=error.column) from error
    except UnicodeDecodeError as error:
        raise BadRequest("The body is no JSON: not UTF-8") from error


def _describe_stream(graph: Graph, iri: NamedNode, protocol: str, stream: StreamLimits | None) -> None:
    """Say that an action can be opened as a stream, and what its samples must keep."""
    if stream is not None:
        graph.add(iri, LF.streamProtocol, Literal(protocol))
        graph.scalar(iri, LF.ageLimit, stream.age_s, SECOND)
        graph.scalar(iri, LF.silenceLimit, stream.silence_s, SECOND)
        graph.scalar(iri, LF.endsAfter, stream.end_s, SECOND)


def segment_of(name: str) -> str:
    """Return the segment of a declared action: never that of a stop, which is neither queued nor limited in rate."""
    return escape(name, {each.segment for each in action_definitions() if each.is_stop} | {"cancel"})


def offers_of(part: DeclaredComponent, handle: Handle | None = None) -> Mapping[str, Offer]:
    """Return the actions of a component by segment; a property that can be set has one of its own name.

    ``handle`` plans them; it is missing in processes that only describe components.
    """
    declared = part.declared
    found = dict[str, Offer]()
    for name, action in declared.actions.items():
        kind = NamedNode(action.semantic_type) if action.semantic_type else LF.ComponentAction
        takes = action.input is not None
        found[segment_of(name)] = _offer(
            part, handle, kind, name, action.title or name, action.description, takes, of_action=name
        )
    for name, each in declared.properties.items():
        if each.writable:
            title = f"Set {each.schema.title or name}"
            found[segment_of(name)] = _offer(
                part, handle, LF.ComponentAction, name, title, each.schema.description, True, of_property=name
            )
    return found


def _offer(
    part: DeclaredComponent,
    handle: Handle | None,
    kind: NamedNode,
    name: str,
    title: str,
    comment: str,
    takes_body: bool,
    *,
    of_action: str = "",
    of_property: str = "",
) -> ComponentOffer:
    definition = ActionDefinition(
        iri=kind,
        segment=segment_of(name),
        title=title,
        comment=comment,
        offered_by=frozenset(),
        offered_if=(),
        capability="",
        methods=(METHODS.POST,),
        consumes=LF.ComponentAction if takes_body else None,  # its own shape is made with the description
        produces=LF.InvocationShape,
    )
    offer: ComponentOffer
    handler = None if handle is None else lambda request: handle(offer, request)
    offer = ComponentOffer(
        definition, part.path, part.robot, handler=handler, part=part, of_action=of_action, of_property=of_property
    )
    return offer
