"""Components of what a configuration names in a ROS graph: ``expose`` makes them, once types are known.

What cannot be a part of the robot is left out, with a sentence. It never keeps the robot from being online.
"""

import logging
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec

from linked_fleet_agent.components.declaration import Declared, DeclaredComponent, Task
from linked_fleet_agent.components.host import declarations_of
from linked_fleet_agent.components.schemas import DeclarationError
from linked_fleet_agent.robots.ros2.configuration import (
    ActionEntry,
    ComponentEntry,
    Configuration,
    EventEntry,
    PropertyEntry,
)
from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.describing import Describing
from linked_fleet_agent.robots.ros2.goals import ActionClient
from linked_fleet_agent.robots.ros2.graph import Graph, Offer
from linked_fleet_agent.robots.ros2.members import (
    ActionGoal,
    Publishers,
    TopicEvent,
    TopicProperty,
    service_task,
    topic_task,
)
from linked_fleet_agent.robots.ros2.selection import Selected, select
from linked_fleet_agent.robots.ros2.types import MessageTypes
from linked_fleet_agent.robots.ros2.views import View
from linked_fleet_agent.wire import declaration as wire

_log = logging.getLogger(__name__)

MAX_COMPONENTS, MAX_PROPERTIES, MAX_ACTIONS, MAX_EVENTS, MAX_BYTES = 48, 192, 96, 96, 196_608
"""Bounds of what is exposed of a robot: three quarters of those of the wire, as its driver has components too."""
_MOST_LEFT_OUT = 3


class RosComponent(DeclaredComponent, blocking=False):
    """A component whose members are topics, services and actions."""

    def __init__(self, name: str, about: ComponentEntry) -> None:
        self.name, self.about = name, about
        self.properties, self.events = dict[str, TopicProperty](), dict[str, TopicEvent]()
        self.tasks, self.goals = dict[str, Task](), dict[str, ActionGoal]()

    def declaration(self) -> Declared:
        said = wire.Component(
            name=self.name,
            title=self.about.title,
            description=self.about.description,
            semantic_type=self.about.kind,
            link=self.about.link,
            rate_hz=self.about.rate_hz,
            stale_s=self.about.stale_s,
            properties={name: each.said for name, each in self.properties.items()},
            actions={name: each.declared for name, each in self.tasks.items()},
            events={name: each.said for name, each in self.events.items()},
        )
        reads = {name: each.read for name, each in self.properties.items()}
        setters = {name: each.setter for name, each in self.properties.items() if each.said.writable}
        return Declared(self, said, reads, self.tasks, setters)

    def unfinished(self) -> Iterable[tuple[str, str]]:
        return [(name, id) for name, each in self.goals.items() for id in each.unfinished()]

    def on_tick(self, now_s: float) -> None:
        if self.emit is None:
            return
        for name, each in self.events.items():
            for data in each.occurrences(now_s):
                self.emit(name, data)


@dataclass
class Exposed:
    """The exposed part of a graph. ``findings`` are sentences about what is not, ``goals`` actions by name in ROS."""

    components: list[RosComponent] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    goals: dict[str, ActionGoal] = field(default_factory=dict)
    _seen: frozenset[tuple[str, str, str]] = frozenset()
    _new: frozenset[tuple[str, str, str]] = frozenset()

    @property
    def moving(self) -> list[ActionClient]:
        """The clients of actions that move something."""
        return [each.client for each in self.goals.values() if each.task.declared.moves]

    def lacks(self, configuration: Configuration, offers: Collection[Offer], namespace: str = "") -> bool:
        """Return True if something has come into the graph that would be exposed too, and was there the last time."""
        new = {each.key for each in select(configuration, offers, namespace).selected} - self._seen
        come, self._new = new & self._new, frozenset(new)
        return bool(come)


async def expose(
    graph: Graph,
    types: MessageTypes,
    configuration: Configuration,
    *,
    namespace: str = "",
    links: Collection[str] = (),
    joints: Collection[str] = (),
    reserved: Iterable[str] = (),
) -> Exposed:
    """Return the components that a configuration makes of a graph.

    ``links`` and ``joints`` are those of the robot, ``reserved`` the names of its other components.
    """
    selection = select(configuration, graph.offers(), namespace)
    made = Exposed(findings=list(selection.missing), _seen=frozenset(each.key for each in selection.selected))
    maker = _Maker(graph, types, configuration, frozenset(reserved), made)
    for each in selection.selected:
        try:
            await maker.add(each)
        except (DefinitionError, DeclarationError) as error:
            made.findings.append(f"{each.entry.ros_name} is left out: {error}")
    made.components = _declarable(maker.components.values(), links, joints, made.findings)
    kept = {id(task) for component in made.components for task in component.tasks.values()}
    made.goals = {name: each for name, each in made.goals.items() if id(each.task) in kept}
    for sentence in made.findings:
        _log.warning("%s", sentence)
    return made


class _Maker:
    def __init__(
        self, graph: Graph, types: MessageTypes, configuration: Configuration, reserved: frozenset[str], made: Exposed
    ) -> None:
        self._graph, self._types, self._configuration, self._reserved = graph, types, configuration, reserved
        self._made, self._publishers, self._bytes = made, Publishers(graph), 0
        self._describing = Describing(graph, types)
        self.components = dict[str, RosComponent]()

    async def add(self, selected: Selected) -> None:
        """Add a member. Raises DefinitionError or DeclarationError if it cannot be one."""
        entry = selected.entry
        component = self._component(entry.component)
        if entry.name in {*component.properties, *component.tasks, *component.events}:
            raise DeclarationError(f"{component.name} has another member {entry.name!r}; name it by the configuration")
        meanings = self._configuration.meanings
        views = list[View]()
        if isinstance(entry, PropertyEntry):
            message = await self._known(selected, self._types.message)
            value = TopicProperty(
                entry, message, self._graph, self._publishers, selected.latched, component.about.stale_s, meanings
            )
            self._check_room(value.said, len(_all(self.components, "properties")), MAX_PROPERTIES)
            component.properties[entry.name], views = value, [value.view]
        elif isinstance(entry, EventEntry):
            happening = TopicEvent(entry, await self._known(selected, self._types.message), self._graph, meanings)
            self._check_room(happening.said, len(_all(self.components, "events")), MAX_EVENTS)
            component.events[entry.name], views = happening, [happening.view]
        elif isinstance(entry, ActionEntry):
            task, views = await self._task(entry, selected)
            self._check_room(task.declared, len(_all(self.components, "tasks")), MAX_ACTIONS)
            component.tasks[entry.name] = task
            if (goal := self._made.goals.get(entry.action)) is not None and not entry.moves:
                component.goals[entry.name] = goal
        self.components[component.name] = component
        self._made.findings += _left_out(entry.ros_name, views)

    async def _task(self, entry: ActionEntry, selected: Selected) -> tuple[Task, list[View]]:
        meanings = self._configuration.meanings
        if entry.topic:
            return topic_task(entry, await self._known(selected, self._types.message), self._graph, meanings)
        if entry.service:
            return service_task(entry, await self._known(selected, self._types.service), self._graph, meanings)
        await self._known(selected, self._types.action)
        goal = ActionGoal(entry, ActionClient(self._graph, self._types, entry.action, entry.type), meanings)
        self._made.goals[entry.action] = goal
        return goal.task, goal.views

    async def _known(self, selected: Selected, find: Any) -> Any:
        """Return a type, which nodes describe if nothing else has it."""
        hashes = selected.hashes
        name = selected.entry.type
        argument = hashes if selected.entry.kind == "action" else hashes.get(name, "")
        try:
            return find(name, argument)
        except DefinitionError:
            await self._describing.describe(name, selected.entry.ros_name, hashes)
            return find(name, argument)

    def _component(self, name: str) -> RosComponent:
        if name in self._reserved:
            raise DeclarationError(f"the driver has a component {name!r} itself; give another one by 'component'")
        if name not in self.components and len(self.components) >= MAX_COMPONENTS:
            raise DeclarationError(f"{MAX_COMPONENTS} components are the maximum of what is exposed of a robot")
        about = self._configuration.components.get(name, ComponentEntry())
        return self.components.get(name) or RosComponent(name, about)

    def _check_room(self, said: Any, count: int, most: int) -> None:
        """Raise DeclarationError if there is no room for a member that is declared so, beside ``count`` others."""
        size = len(msgspec.json.encode(said))
        if count >= most:
            raise DeclarationError(f"{most} members of its kind are the maximum of what is exposed of a robot")
        if self._bytes + size > MAX_BYTES:
            raise DeclarationError(f"the declarations would have more than {MAX_BYTES} bytes")
        self._bytes += size


def _all(components: Mapping[str, RosComponent], part: str) -> list[str]:
    return [name for each in components.values() for name in getattr(each, part)]


def _left_out(name: str, views: Iterable[View]) -> list[str]:
    said = [sentence for view in views for sentence in view.left_out]
    more = f", and {len(said) - _MOST_LEFT_OUT} more" if len(said) > _MOST_LEFT_OUT else ""
    return [f"{name} lacks {'; '.join(said[:_MOST_LEFT_OUT])}{more}"] if said else []


def _declarable(
    components: Iterable[RosComponent], links: Collection[str], joints: Collection[str], findings: list[str]
) -> list[RosComponent]:
    """Return the components that gateways accept, and add a finding for each of the others."""
    accepted = list[RosComponent]()
    for each in components:
        try:
            declarations_of([each], links, joints)
        except DeclarationError as error:
            findings.append(f"component {each.name!r} is left out: {error}")
        else:
            accepted.append(each)
    return accepted
