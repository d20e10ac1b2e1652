"""The components of a robot as a whole: their places, shapes, validators and vocabulary, each made when it is needed.

A declaration may have thousands of members. ``compile_declarations`` costs about a millisecond; the first use
of a shape costs what its own members cost, so that the one of an untrusted declaration belongs into a thread.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_agent.wire.components import Action, Component, Event, Property
from linked_fleet_agent.wire.schema import Schema, value_problem
from linked_fleet_base.errors import Statement
from linked_fleet_gateway.extensions.components.places import (
    Kind,
    Place,
    linking_types,
    place_of,
    term_iri,
    vocabulary_iri,
)
from linked_fleet_gateway.extensions.components.shapes import ShapeWriter
from linked_fleet_gateway.extensions.components.values import (
    add_members,
    add_value,
    add_value_in_steps,
    members_in,
    value_in,
)
from linked_fleet_gateway.extensions.components.vocabulary import describe_event, describe_link, describe_terms
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_rdf.validation import ShaclValidator, reachable_statements
from linked_fleet_rdf.vocabulary import LF, OWL, PREFIXES
from linked_fleet_shacl import Data

_NOTHING = Schema(type="object")
_SHAPE = BlankNode("shape")
Refusal = tuple[str, list[Statement]]
"""A sentence about what is wrong, and the report of the shape."""


@dataclass(frozen=True)
class Input:
    """The body that a client may send: the members of an object, or a value as ``lf:value`` (``is_value``)."""

    place: Place
    is_value: bool = False

    def describe_shape(self, graph: Graph, node: Node) -> None:
        writer = ShapeWriter(graph)
        (writer.value_shape if self.is_value else writer.object_shape)(node, self.place)

    @property
    def is_compiled(self) -> bool:
        """False before ``validator``, which takes up to tens of milliseconds, was first used."""
        return "validator" in self.__dict__

    @cached_property
    def validator(self) -> ShaclValidator:
        graph = Graph()
        self.describe_shape(graph, _SHAPE)
        vocabulary = self.place.term.value.partition("#")[0] + "#"
        return ShaclValidator(graph.statements.keys(), _SHAPE, {"robot": vocabulary, **PREFIXES})

    def describe(self, graph: Graph, node: Node, value: Any) -> None:
        """Add a JSON value as a client would state it about ``node``."""
        if self.is_value:
            add_value(graph, self.place, value, node, LF.value)
        else:
            add_members(graph, self.place, value, node)

    def read(self, body: Sequence[Triple], focus: Node) -> tuple[Any, Refusal | None]:
        """Return the JSON value that a body states about ``focus``; or None and why it is refused."""
        if shared := _used_twice(body):
            return None, (f"{shared} is the value of several properties, or of itself; state each value once", [])
        if (refused := self.validator.report(body, focus)) is not None:
            return None, refused
        data, place = Data(body), self.place
        value = (
            value_in(data, place, data.objects(focus, LF.value)[0]) if self.is_value else members_in(data, place, focus)
        )
        # Where rounding of a decimal or of another unit leads out of the limits.
        problem = value_problem(place.schema, value)
        return (None, (problem, [])) if problem else (value, None)

    def unused(self, body: Sequence[Triple], focus: Node) -> list[Triple]:
        """Return the triples of a body that conforms which are not part of the value."""
        first = [each for each in body if each.subject == focus and (not self.is_value or each.predicate == LF.value)]
        values = [each.object for each in first if isinstance(each.object, BlankNode)]
        used = {*first, *reachable_statements(body, *values)}
        return [each for each in body if each not in used]


def _used_twice(body: Sequence[Triple]) -> str:
    """Return a node with statements that several others lead to; without one, values are trees of the body's size."""
    subjects = {triple.subject for triple in body}
    seen = set[object]()
    for triple in dict.fromkeys(body):
        value = triple.object
        if isinstance(value, Literal) or value not in subjects:
            continue
        if value in seen:
            return f"<{value.value[:200]}>" if isinstance(value, NamedNode) else "a blank node"
        seen.add(value)
    return ""


@dataclass(frozen=True)
class CompiledProperty:
    """A property of a component; ``predicate`` links the component to its resource."""

    declared: Property
    term: str
    predicate: NamedNode

    @cached_property
    def place(self) -> Place:
        return place_of(self.declared.schema, self.term, self.predicate)

    @cached_property
    def input(self) -> Input:
        """Return what sets a property that is writable."""
        return Input(self.place, is_value=True)

    def describe(self, graph: Graph, iri: Node, value: Any) -> None:
        """Add the value of the resource ``iri``; None is unknown."""
        add_value(graph, self.place, value, iri, LF.value)

    def describe_in_steps(self, graph: Graph, iri: Node, value: Any) -> Iterator[None]:
        return add_value_in_steps(graph, self.place, value, iri, LF.value)

    def describe_shape(self, graph: Graph, node: Node) -> None:
        """Make ``node`` also the shape of the resource."""
        ShapeWriter(graph, of_output=True).value_shape(node, self.place)


@dataclass(frozen=True)
class CompiledAction:
    """An action of a component. An action without input takes an object without members."""

    declared: Action
    terms: Mapping[Kind, str]

    @cached_property
    def input(self) -> Input:
        return Input(place_of(self.declared.input or _NOTHING, self.terms["input"]))

    @cached_property
    def feedback(self) -> Place | None:
        return _place(self.declared.feedback, self.terms["feedback"])

    @cached_property
    def result(self) -> Place | None:
        return _place(self.declared.result, self.terms["result"])


@dataclass(frozen=True)
class CompiledEvent:
    """An event of a component."""

    declared: Event
    term: str

    @cached_property
    def data(self) -> Place | None:
        return _place(self.declared.data, self.term)


def _place(schema: Schema | None, term: str) -> Place | None:
    return None if schema is None else place_of(schema, term)


@dataclass(frozen=True)
class CompiledComponent:
    """A component, and its parts by name."""

    declared: Component
    properties: Mapping[str, CompiledProperty]
    actions: Mapping[str, CompiledAction]
    events: Mapping[str, CompiledEvent]

    def describe_terms(self, graph: Graph) -> None:
        for part in self.properties.values():
            describe_link(graph, part.place)
        data = [each for part in self.actions.values() for each in (part.input.place, part.feedback, part.result)]
        for place in (*data, *(event.data for event in self.events.values())):
            if place is not None:
                describe_terms(graph, place)
        for name, event in self.events.items():
            describe_event(graph, NamedNode(event.term), event.declared.title or name, event.declared.description)


@dataclass(frozen=True)
class CompiledDeclarations:
    """The components of a robot by name, and the IRI of its vocabulary."""

    vocabulary: NamedNode
    components: Mapping[str, CompiledComponent]

    def describe_vocabulary(self, graph: Graph) -> None:
        """Describe the vocabulary and each of its terms."""
        graph.a(self.vocabulary, OWL.Ontology)
        for component in self.components.values():
            component.describe_terms(graph)


def compile_declarations(components: Sequence[Component], robot: str) -> CompiledDeclarations:
    """Return the components of the robot with the IRI ``robot``, which ends in a slash.

    ``declaration_problem`` has accepted them.
    """
    return CompiledDeclarations(
        NamedNode(vocabulary_iri(robot)), {each.name: _compile(each, robot) for each in components}
    )


def _compile(component: Component, robot: str) -> CompiledComponent:
    def term(kind: Kind, name: str) -> str:
        return term_iri(robot, component.name, kind, name)

    types = {name: each.schema.semantic_type for name, each in component.properties.items()}
    linked = linking_types(types, vocabulary_iri(robot))
    properties = {
        name: CompiledProperty(each, own := term("property", name), linked.get(name) or NamedNode(own))
        for name, each in component.properties.items()
    }
    actions = {
        name: CompiledAction(each, {kind: term(kind, name) for kind in ("input", "feedback", "result")})
        for name, each in component.actions.items()
    }
    events = {name: CompiledEvent(each, term("event", name)) for name, each in component.events.items()}
    return CompiledComponent(component, properties, actions, events)
