"""A component as a part of its robot: its description, properties, events and actions."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property, lru_cache, partial
from typing import Any

import msgspec
from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.planar import DriveLimits
from linked_fleet_agent.wire.components import Component, read_declarations
from linked_fleet_agent.wire.keys import escape
from linked_fleet_agent.wire.kinds import KINDS
from linked_fleet_gateway.extensions.components import bases
from linked_fleet_gateway.extensions.components.component import BASES, DeclaredComponent
from linked_fleet_gateway.extensions.components.copies import read_state, write_state
from linked_fleet_gateway.extensions.components.items import (
    event_item,
    event_members,
    event_schemas,
    or_null,
    property_item,
    schema_json,
)
from linked_fleet_gateway.extensions.components.offers import ComponentOffer, Handle, offers_of, segment_of
from linked_fleet_gateway.extensions.components.places import vocabulary_iri
from linked_fleet_gateway.extensions.components.state import RobotState
from linked_fleet_gateway.extensions.components.terms import LF
from linked_fleet_gateway.extensions.components.values import add_members, add_value, has_more_values
from linked_fleet_gateway.faces import Json, Offer, PartCopier, Property, RobotPart, link_path, parts_of, robot_path
from linked_fleet_rdf.graph import HERTZ, SECOND, Graph, integer
from linked_fleet_rdf.vocabulary import RDF, RDFS, SOSA
from linked_fleet_state.answers import DescriptionAndComponents
from linked_fleet_state.driving import FollowedPath
from linked_fleet_state.gripper import Gripper
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.model import RobotModel
from linked_fleet_state.robot import Robot

_RESERVED = ("actions", "blueprint", "linkset", "subscriptions")
"""Segments below a component that are no properties of it."""
_EVENT_MARK = "~event"
_BATTERY, _GRIPPER = LF.extended("Battery").Battery.value, LF.extended("Gripper").Gripper.value
_JSON = RDF.extended("JSON").JSON
_MOST_VALUES = 1_000
"""Values of a feedback or result that are described as RDF; one with more is there as one literal, in JSON."""
_COUNTS = ("applied", "late", "reordered", "future", "invalid")


class ComponentPart(DeclaredComponent):
    """A component as a part of its robot; ``handle`` plans its actions, in a process that carries them out."""

    def __init__(
        self, robot: Robot, model: RobotModel, state: RobotState, name: str, handle: Handle | None = None
    ) -> None:
        super().__init__(robot, model, state, name)
        self.segment = self.path.rpartition("/")[2]
        self.offers: Mapping[str, Offer] = offers_of(self, handle)
        self._items = lru_cache(BASES)(self._make_items)
        self._paths = dict[str, str]()

    @property
    def copier(self) -> type[PartCopier]:
        return ComponentCopier

    @cached_property
    def types(self) -> Sequence[NamedNode]:
        kind = self.declared.semantic_type
        return (LF.Component, NamedNode(kind)) if kind else (LF.Component,)

    @property
    def is_battery(self) -> bool:
        return self.declared.semantic_type == _BATTERY

    @property
    def battery_percent(self) -> float | None:
        if not self.is_battery or not self.is_current:
            return None
        charge = self.state.value("charge")
        return None if charge is None else float(charge)

    @property
    def path_ahead(self) -> FollowedPath | None:
        path = self.state.value("path") if bases.is_base(self.declared) and self.is_current else None
        return bases.followed_path(self.state, path) if path else None

    @property
    def drive_limits(self) -> DriveLimits | None:
        return bases.drive_limits(self.state) if bases.is_base(self.declared) and self.is_current else None

    @property
    def gripper(self) -> Gripper | None:
        if self.declared.semantic_type != _GRIPPER:
            return None
        joints = dict.fromkeys(each for name in ("grasp", "open") for each in self.declared.actions[name].moves)
        if not self.is_current:
            return Gripper(tuple(joints), self.declared.link)
        state, lost = self.state, self.state.events.get("lost")
        since_ns = state.times_ns.get("holding", 0)
        lost_ns = 0 if lost is None else lost.wall_ns
        return Gripper(tuple(joints), self.declared.link, state.value("holding"), since_ns, lost_ns)

    @property
    def shapes(self) -> Sequence[NamedNode]:
        kind = self.declared.semantic_type
        return (LF.ComponentShape, NamedNode(kind + "Shape")) if kind in KINDS else (LF.ComponentShape,)

    def path_of(self, item: str) -> str:
        """Return the path of a declared property or event."""
        if (path := self._paths.get(item)) is None:
            is_event = item in self.declared.events and item not in self.declared.properties
            segment = self._event_segment(item) if is_event else escape(item, _RESERVED)
            path = self._paths[item] = f"{self.path}/{segment}"
        return path

    def _event_segment(self, name: str) -> str:
        """Return the segment of an event. One that shares its name with a property gets a mark."""
        return escape(name, _RESERVED) + (_EVENT_MARK if name in self.declared.properties else "")

    def properties(self, base: str) -> Sequence[Property]:
        """Return its properties and its events."""
        return self._items(base)

    def _make_items(self, base: str) -> tuple[Property, ...]:
        compiled = self.compiled(base)
        items = [
            property_item(self, name, escape(name, _RESERVED), each, self.offers.get(segment_of(name)), base)
            for name, each in compiled.properties.items()
        ]
        events = [
            event_item(self, name, self._event_segment(name), each, base) for name, each in compiled.events.items()
        ]
        return (*items, *events)

    def facts(self) -> object:
        """Return all that its description depends on, except its properties."""
        return self.declared, self.state.fault, self.is_current

    def describe(self, graph: Graph, iri: NamedNode, base: str) -> None:
        """Add what it declares about itself."""
        said, robot = self.declared, self.robot
        if said.description:
            graph.add(iri, RDFS.comment, Literal(said.description))
        if said.link:
            graph.add(iri, SOSA.isHostedBy, NamedNode(base + link_path(robot.name, self._model, said.link)))
        if self.is_current and self.state.fault:
            graph.add(iri, LF.fault, Literal(self.state.fault))
        graph.scalar(iri, LF.publishedAt, said.rate_hz, HERTZ)
        graph.scalar(iri, LF.unknownAfter, said.stale_s, SECOND)
        graph.add(iri, LF.vocabulary, NamedNode(vocabulary_iri(base + robot_path(robot.name))))

    def json(self) -> bytes:
        """Return the present values in JSON, by property."""
        current = self.is_current
        return msgspec.json.encode(
            {name: self.state.value(name) if current else None for name in self.declared.properties}
        )

    @property
    def json_schema(self) -> Json:
        values = {name: or_null(schema_json(each.schema)) for name, each in self.declared.properties.items()}
        return _object(values) | {"required": list(values)}

    def streams(self) -> Mapping[str, tuple[Json, Callable[[], bytes]]]:
        """Return its values together, and each of its events, by path."""
        return self._streams

    @cached_property
    def _streams(self) -> Mapping[str, tuple[Json, Callable[[], bytes]]]:
        declared, found = self.declared, dict[str, tuple[Json, Callable[[], bytes]]]()
        if values := {name: schema_json(each.schema) for name, each in declared.properties.items()}:
            found[self.path] = _object(values), self._known_values
        for name, each in declared.events.items():
            found[f"{self.path}/{self._event_segment(name)}"] = (
                _object(event_schemas(each)),
                partial(self._event, name),
            )
        return found

    def _known_values(self) -> bytes:
        known = self.state.values if self.is_current else {}
        return msgspec.json.encode({name: value for name, value in known.items() if value is not None})

    def _event(self, name: str) -> bytes:
        last = self.state.events.get(name) if self.is_current else None
        return msgspec.json.encode(event_members(self.declared.events[name], last))

    def describe_outcome(self, graph: Graph, iri: NamedNode, base: str, invocation: Invocation) -> None:
        """Add the feedback and the result of an invocation of one of its actions."""
        if (counts := invocation.stream) is not None:
            node = graph.blank()
            graph.add(iri, LF.samples, node)
            for name in _COUNTS:
                graph.add(node, getattr(LF, name), integer(getattr(counts, name)))
        for predicate, said, value in self._outcomes(invocation):
            node = graph.blank()
            graph.add(iri, predicate, node)
            action = self.compiled(base).actions.get(self._action_of(invocation))
            place = getattr(action, said, None)
            # Without a place, the robot declares something else by now.
            if place is None or has_more_values(value, _MOST_VALUES):
                graph.add(node, LF.value, Literal(msgspec.json.encode(value).decode(), datatype=_JSON))
            elif isinstance(value, Mapping):
                add_members(graph, place, value, node)
            else:
                add_value(graph, place, value, node, LF.value)

    def outcome_json(self, invocation: Invocation) -> Mapping[str, Any]:
        """Return the feedback and the result of an invocation in JSON, by name."""
        found = {"output" if said == "result" else said: value for _, said, value in self._outcomes(invocation)}
        return found if invocation.stream is None else found | {"samples": msgspec.structs.asdict(invocation.stream)}

    def _outcomes(self, invocation: Invocation) -> list[tuple[NamedNode, str, Any]]:
        stored = ((LF.feedback, "feedback", invocation.feedback), (LF.output, "result", invocation.outcome))
        return [(predicate, said, msgspec.json.decode(text)) for predicate, said, text in stored if text]

    def _action_of(self, invocation: Invocation) -> str:
        offer = self.offers.get(invocation.action.rpartition("/")[2])
        return offer.of_action if isinstance(offer, ComponentOffer) else ""


def _object(members: Json) -> Json:
    return {"type": "object", "properties": members}


def parts_from(
    robot: Robot, model: RobotModel, components: Iterable[Component], state: RobotState, handle: Handle | None = None
) -> dict[str, ComponentPart]:
    """Return the components of a robot by segment; ``handle`` as of ``ComponentPart``."""
    parts = (ComponentPart(robot, model, state, each.name, handle) for each in components)
    return {each.segment: each for each in parts}


class ComponentCopier:
    """Copies the components of a robot to processes that hear no robot: ``linked_fleet_gateway.faces.PartCopier``."""

    @staticmethod
    def version(robot: Robot) -> object:
        state = _state_of(robot)
        return state and (state, state.incarnation, state.changes)

    @staticmethod
    def write(robot: Robot) -> bytes:
        state = _state_of(robot)
        return b"" if state is None else write_state(state)

    @staticmethod
    def make(robot: Robot) -> Mapping[str, RobotPart]:
        said, model = robot.description, robot.model
        if not isinstance(said, DescriptionAndComponents) or model is None:
            return {}
        components, _ = read_declarations(said.components, model.links, model.joints)
        return parts_from(robot, model, components, RobotState(components, said.incarnation))

    @staticmethod
    def read(robot: Robot, values: bytes) -> None:
        state = _state_of(robot)
        if state is not None and values:
            read_state(state, values)


def _state_of(robot: Robot) -> RobotState | None:
    part = next(iter(parts_of(robot).values()), None)
    return part.whole if isinstance(part, ComponentPart) else None
