"""The part of a ROS graph that belongs to one robot: what is offered below its namespace, read with the right types."""

from collections.abc import Mapping, Sequence
from typing import Any

from linked_fleet_agent.robots.ros2.goals import ActionClient
from linked_fleet_agent.robots.ros2.graph import Graph, Interface, Outlet, Role
from linked_fleet_agent.robots.ros2.inbox import Inbox
from linked_fleet_agent.robots.ros2.services import ask, hash_of, parameters_of
from linked_fleet_agent.robots.ros2.types import MessageType, MessageTypes

_SEND_GOAL = "/_action/send_goal"


class OwnGraph:
    """The offers of the graph to one robot. Names of its components are unique."""

    def __init__(self, graph: Graph, types: MessageTypes, namespace: str) -> None:
        self.graph, self.types, self.namespace = graph, types, namespace
        self.inboxes = list[Inbox]()
        self._names = set[str]()

    def offered(self, role: Role, type: str, everywhere: bool = False) -> list[Interface]:
        """Return the interfaces of a type that other nodes have in a role, below the namespace or everywhere."""
        found = {each.interface for each in self.graph.offers() if (each.role, each.interface.type) == (role, type)}
        own = f"{self.namespace}/"
        return sorted((each for each in found if everywhere or each.name.startswith(own)), key=lambda each: each.name)

    def actions(self, type: str) -> list[ActionClient]:
        """Return clients of the actions of a type. Raises DefinitionError for one that is not as others have it."""
        names = [each.name.removesuffix(_SEND_GOAL) for each in self.offered("service", f"{type}_SendGoal")]
        return [ActionClient(self.graph, self.types, name, type) for name in names]

    def inbox(self, topic: Interface, latched: bool = False) -> Inbox:
        """Subscribe to a topic. Raises DefinitionError if its type is not known."""
        made = Inbox(self.graph, topic.name, self.type_of("publisher", topic), latched=latched)
        self.inboxes.append(made)
        return made

    def outlet(self, topic: Interface) -> tuple[Outlet, MessageType]:
        """Return a publisher to the subscribers of a topic, and the type that they have."""
        return self.graph.outlet(topic), self.type_of("subscription", topic)

    def type_of(self, role: Role, topic: Interface) -> MessageType:
        return self.types.message(topic.type, hash_of(self.graph.offers(), role, topic.name, topic.type))

    async def ask(self, service: Interface, request: dict[str, Any]) -> dict[str, Any]:
        """Call a service. Raises NoAnswerError."""
        return await ask(self.graph, self.types, service.name, service.type, request)

    async def parameters(self, node: str, names: Sequence[str]) -> Mapping[str, object]:
        """Return parameters of a node by name; nothing if it does not say."""
        return await parameters_of(self.graph, self.types, node, names)

    def name(self, usual: str, interface: Interface, among: Sequence[object]) -> str:
        """Return a name for a component: the usual one, or one after the interface if there are several."""
        local = interface.name.removeprefix(f"{self.namespace}/")
        found = usual if len(among) == 1 and usual not in self._names else local.replace("/", "_")
        self._names.add(found)
        return found
