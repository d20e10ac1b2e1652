"""A ROS graph in memory: topics, services and actions of nodes that a test plays, for drivers on virtual time."""

import asyncio
import math
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.goals import CANCEL_GOAL, CANCELED, EXECUTING, STATUS_ARRAY, SUCCEEDED
from linked_fleet_agent.robots.ros2.graph import CallError, Interface, Mailbox, Offer, Role
from linked_fleet_agent.robots.ros2.type_descriptions import description
from linked_fleet_agent.robots.ros2.types import GET_TYPE_DESCRIPTION, MessageType, MessageTypes

TYPES = MessageTypes()
Answer = Callable[[dict[str, Any]], Mapping[str, Any] | None]


class MemoryOutlet:
    """A publisher of the driver. ``said`` has its messages."""

    def __init__(self, graph: "MemoryGraph", topic: Interface) -> None:
        self._graph, self._topic = graph, topic
        self.said: list[dict[str, Any]] = []

    @property
    def has_subscribers(self) -> bool:
        return self._graph.has("subscription", self._topic)

    def put(self, payload: bytes) -> None:
        self.said.append(self._graph.types.message(self._topic.type).read(payload))
        self._graph.deliver(self._topic, payload)


class MemoryGraph:
    """Implements ``linked_fleet_agent.robots.ros2.graph.Graph``. Methods below ``close`` are for tests.

    A service whose answer is None is silent: its callers wait. A server that has ``left`` is not offered any more.
    With ``hashes`` nodes state those of their types. The transport ends calls after ``patience_s``. While the graph is
    ``cut``, nothing gets through, as if a router or a bridge were down.
    """

    def __init__(self, types: MessageTypes = TYPES, hashes: bool = False, patience_s: float = math.inf) -> None:
        self.version, self.cut = 0, False
        self.types, self._hashes, self._patience_s = types, hashes, patience_s
        self._offers: dict[Offer, None] = {}
        self._boxes: list[tuple[Interface, Mailbox, bool]] = []
        self._latched: dict[Interface, bytes] = {}
        self._services: dict[Interface, Callable[[bytes], Any]] = {}
        self.outlets: dict[Interface, MemoryOutlet] = {}
        self.calls: list[tuple[str, dict[str, Any]]] = []

    def offers(self) -> Collection[Offer]:
        return [] if self.cut else list(self._offers)

    def subscribe(self, topic: Interface, longest: int, most: int = 32, latched: bool = False) -> Mailbox:
        box = Mailbox(longest, most)
        self._boxes.append((topic, box, latched))
        if latched and topic in self._latched:
            box.put(self._latched[topic])
        return box

    def outlet(self, topic: Interface) -> MemoryOutlet:
        return self.outlets.setdefault(topic, MemoryOutlet(self, topic))

    async def call(self, service: Interface, request: bytes, longest: int) -> bytes:
        if not self.has("service", service):
            raise CallError(f"no node offers the service {service.name}")
        try:
            async with asyncio.timeout(None if math.isinf(self._patience_s) else self._patience_s):
                answer = await self._services[service](request)
        except TimeoutError:
            raise CallError(f"{service.name} has not answered for {self._patience_s:g} s") from None
        if self.cut:
            raise CallError(f"the answer of {service.name} was lost")
        if len(answer) > longest:
            raise CallError(f"{service.name} answered with {len(answer)} bytes; {longest} is the maximum")
        return bytes(answer)

    def close(self) -> None:
        pass

    def offer(self, role: Role, name: str, type: str, latched: bool = False, type_hash: str = "") -> Interface:
        """Let a node have a publisher, a subscription, a server or a client. It may state any hash of its type."""
        interface = Interface(name, type)
        type_hash = type_hash or (self.types.message(type).hash if self._hashes else "")
        self._offers[Offer(role, interface, type_hash, latched)] = None
        self.version += 1
        return interface

    def has(self, role: Role, interface: Interface) -> bool:
        """Return True if a node has this."""
        return any((each.role, each.interface) == (role, interface) for each in self.offers())

    def heal(self) -> None:
        """End the cut. Latched topics arrive once more, as from a publisher that is found again."""
        self.cut, self.version = False, self.version + 1
        for topic, box, latched in self._boxes:
            if latched and topic in self._latched:
                box.put(self._latched[topic], time.monotonic())

    def leave(self, *names: str) -> None:
        """Let the nodes that have these interfaces go."""
        self._offers = {each: None for each in self._offers if each.interface.name not in names}
        self.version += 1

    def publish(self, name: str, type: str, value: Mapping[str, Any] | bytes, latched: bool = False) -> None:
        """Publish a message, which may be any bytes."""
        topic = self.offer("publisher", name, type, latched)
        payload = value if isinstance(value, bytes) else self.types.message(type).write(value)
        if latched:
            self._latched[topic] = payload
        self.deliver(topic, payload)

    def deliver(self, topic: Interface, payload: bytes) -> None:
        """Let subscribers have a message, or know that it is too long."""
        for subscribed, box, _ in self._boxes:
            if subscribed == topic and not self.cut:
                box.put(payload if len(payload) <= box.longest else None, time.monotonic())

    def serve(self, name: str, type: str, answer: Answer) -> None:
        """Offer a service. ``answer`` returns the fields of the response to a request, or None to be silent."""
        known = self.types.service(type)

        async def reply(request: bytes) -> bytes:
            asked = known.request.read(request)
            self.calls.append((name, asked))
            said = answer(asked)
            if said is None:
                await asyncio.Event().wait()
            return known.response.write(said or {})

        self.serve_bytes(name, type, reply)

    def serve_bytes(self, name: str, type: str, answer: Callable[[bytes], Any]) -> None:
        """Offer a service whose coroutine returns the bytes of the response."""
        self._services[self.offer("service", name, type)] = answer

    def describe_types(self, node: str, types: MessageTypes) -> None:
        """Let a node describe the types that it knows, and refuse others."""

        def answer(asked: dict[str, Any]) -> Mapping[str, Any]:
            try:
                known = types.message(asked["type_name"], asked["type_hash"])
            except DefinitionError as error:
                return {"successful": False, "failure_reason": str(error)}
            return {"successful": True, "type_description": description_of(known)}

        self.serve(f"{node}/get_type_description", GET_TYPE_DESCRIPTION, answer)


def description_of(type: MessageType) -> dict[str, Any]:
    """Return a TypeDescription, in which fields have defaults."""
    said = description(type.definitions, type.name)
    for each in (said["type_description"], *said["referenced_type_descriptions"]):
        for field in each["fields"]:
            field["default_value"] = ""
    return said


class MemoryAction:
    """An action server that does what a test says. ``goals`` has those that it has accepted, by id."""

    def __init__(self, graph: MemoryGraph, name: str, type: str) -> None:
        self.graph, self.name, self.type = graph, name, graph.types.action(type)
        self.goals: dict[bytes, dict[str, Any]] = {}
        self.statuses: dict[bytes, int] = {}
        self.begun_s: dict[bytes, float] = {}
        self.accepts = self.ends_when_cancelled = True
        self._ends: dict[bytes, asyncio.Future[tuple[int, Mapping[str, Any]]]] = {}
        part = f"{name}/_action/"
        graph.offer("publisher", f"{part}feedback", self.type.feedback_message.name)
        graph.offer("publisher", f"{part}status", STATUS_ARRAY, latched=True)
        graph.serve(f"{part}send_goal", self.type.send_goal.name, self._accept)
        graph.serve(f"{part}cancel_goal", CANCEL_GOAL, self._cancel)
        graph.serve_bytes(f"{part}get_result", self.type.get_result.name, self._result)

    @property
    def names(self) -> list[str]:
        """The names of its services and topics."""
        return [
            f"{self.name}/_action/{each}" for each in ("feedback", "status", "send_goal", "cancel_goal", "get_result")
        ]

    def tell(self, goal_id: bytes, **feedback: Any) -> None:
        """Publish feedback."""
        said = {"goal_id": {"uuid": goal_id}, "feedback": feedback}
        self.graph.publish(f"{self.name}/_action/feedback", self.type.feedback_message.name, said)

    def end(self, goal_id: bytes, status: int = SUCCEEDED, **result: Any) -> None:
        """End a goal."""
        self._set(goal_id, status)
        if not self._ends[goal_id].done():
            self._ends[goal_id].set_result((status, result))

    def forget(self) -> None:
        """Know no goal any more, as after a restart."""
        for each in self._ends.values():
            if not each.done():
                each.set_exception(CallError(f"{self.name} did not answer"))
                each.exception()  # perhaps nobody waits for it
        self.goals.clear()
        self._ends.clear()
        self.statuses.clear()

    def adopt(self, goal_id: bytes) -> None:
        """Have a goal of another client."""
        self.goals[goal_id], self.begun_s[goal_id] = {}, time.monotonic()
        self._ends[goal_id] = asyncio.get_running_loop().create_future()
        self._set(goal_id, EXECUTING)

    def _accept(self, asked: dict[str, Any]) -> Mapping[str, Any]:
        goal_id = bytes(asked["goal_id"]["uuid"])
        accepted = self.accepts and goal_id not in self.goals
        if accepted:
            self.adopt(goal_id)
            self.goals[goal_id] = asked["goal"]
        return {"accepted": accepted}

    def _cancel(self, asked: dict[str, Any]) -> Mapping[str, Any]:
        wanted = bytes(asked["goal_info"]["goal_id"]["uuid"])
        running = [each for each, status in self.statuses.items() if status == EXECUTING]
        ended = [each for each in running if wanted in (each, bytes(16))] if self.ends_when_cancelled else []
        for each in ended:
            self.end(each, CANCELED)
        return {"return_code": 0 if ended else 1, "goals_canceling": [{"goal_id": {"uuid": each}} for each in ended]}

    async def _result(self, request: bytes) -> bytes:
        asked = self.type.get_result.request.read(request)
        end = self._ends.get(bytes(asked["goal_id"]["uuid"]))
        status, result = (0, {}) if end is None else await asyncio.shield(end)
        return self.type.get_result.response.write({"status": status, "result": result})

    def _set(self, goal_id: bytes, status: int) -> None:
        self.statuses[goal_id] = status
        said = [{"goal_info": {"goal_id": {"uuid": each}}, "status": of} for each, of in self.statuses.items()]
        self.graph.publish(f"{self.name}/_action/status", STATUS_ARRAY, {"status_list": said}, latched=True)
