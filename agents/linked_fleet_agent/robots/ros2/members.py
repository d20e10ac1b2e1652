"""Topics, services and actions of ROS as the properties, events and actions of components."""

import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from msgspec import UNSET

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.declaration import Task
from linked_fleet_agent.robots.ros2.configuration import ActionEntry, EventEntry, PropertyEntry
from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.goal_runs import follow_goal, run_goal
from linked_fleet_agent.robots.ros2.goals import ActionClient
from linked_fleet_agent.robots.ros2.graph import Graph, Interface
from linked_fleet_agent.robots.ros2.inbox import Inbox
from linked_fleet_agent.robots.ros2.serialization import MAX_MESSAGE_BYTES
from linked_fleet_agent.robots.ros2.types import ActionType, MessageType, ServiceType
from linked_fleet_agent.robots.ros2.units import Meaning, Meanings
from linked_fleet_agent.robots.ros2.views import View
from linked_fleet_agent.wire import declaration as wire
from linked_fleet_agent.wire.components import MAX_EVENT_BYTES, MAX_FEEDBACK_BYTES
from linked_fleet_agent.wire.schema import Schema, value_problem

_log = logging.getLogger(__name__)

MAX_TOPIC_BYTES = 65_536
"""Longest message of a topic that is a property or an event; values may have a quarter of that."""
SERVICE_S, MOTION_S, ACTION_S = 10.0, 3600.0, 86_400.0
"""Time that a service, an action that moves something and another one may take, without configuration."""
_BURST, _MOST_TAKEN_UP = 16, 32
_NO_DATA = Schema(type="object")


class Publishers:
    """The topics that have a publisher now, found once for each version of the graph."""

    def __init__(self, graph: Graph) -> None:
        self._graph, self._version = graph, -1
        self._topics = frozenset[str]()

    def has(self, topic: str) -> bool:
        if self._version != self._graph.version:
            self._version = self._graph.version
            self._topics = frozenset(each.interface.name for each in self._graph.offers() if each.role == "publisher")
        return topic in self._topics


class TopicProperty:
    """A topic that is a property. It is unknown if its last message is old, too long or malformed."""

    def __init__(
        self, entry: PropertyEntry, type_: MessageType, graph: Graph, publishers: Publishers, latched: bool,
        stale_s: float, meanings: Meanings,
    ) -> None:  # fmt: skip
        own = {f"{type_.name}.{entry.field}" if entry.field else type_.name: Meaning(entry.unit, entry.term)}
        given = {**meanings, **own} if entry.unit or entry.term else meanings
        self._entry, self._type, self._publishers = entry, type_, publishers
        self.view = View(type_, given, entry.field, "all" if entry.write else "certain")
        self._latched = latched if entry.latched is None else entry.latched
        self._stale_s = stale_s if entry.stale_s is None else entry.stale_s
        self._inbox = Inbox(graph, entry.topic, type_, latched=self._latched, longest=MAX_TOPIC_BYTES, most=1)
        self._outlet = graph.outlet(Interface(entry.topic, type_.name)) if entry.write else None
        self._written: tuple[float, Any] = (-math.inf, None)
        self._shown: tuple[float, Any] = (-math.inf, None)
        self._seen_s = -math.inf
        schema = self.view.schema
        self.said = wire.Property(
            schema=msgspec.structs.replace(
                schema,
                title=entry.title or schema.title,
                description=entry.description or schema.description or f"The topic {entry.topic}, a {type_.name}.",
            ),
            writable=entry.write,
        )

    def read(self) -> Any:
        """Return the value, or None if it is unknown."""
        now_s, message = time.monotonic(), self._inbox.newest()
        written_s, written = self._written
        if written_s > self._inbox.at_s and self._is_kept(now_s, written_s):
            return written
        if not message or not self._is_kept(now_s, self._inbox.at_s):
            return None
        if self._inbox.at_s != self._shown[0]:
            self._shown = self._inbox.at_s, self.view.value(message)
        return self._shown[1]

    def _is_kept(self, now_s: float, at_s: float) -> bool:
        if self._latched and (self._outlet is not None or self._publishers.has(self._entry.topic)):
            self._seen_s = now_s
        return now_s - max(at_s, self._seen_s if self._latched else at_s) <= self._stale_s

    def set(self, value: Any) -> None:
        """Publish a message with this value. Raises CdrError, and ValueError if nobody listens."""
        assert self._outlet is not None
        payload = self._type.write(self.view.message(value))
        if not self._outlet.has_subscribers:
            raise ValueError(f"no node listens to {self._entry.topic}")
        self._outlet.put(payload)
        self._written = time.monotonic(), value

    @property
    def setter(self) -> Task:
        given = msgspec.defstruct("Setting", [("value", Any)], forbid_unknown_fields=True)
        return Task(self._set, wire.Action(duration_s=SERVICE_S), given)

    async def _set(self, value: Any) -> None:
        self.set(value)


class TopicEvent:
    """A topic whose messages are events. Those beyond its rate are dropped and counted."""

    def __init__(self, entry: EventEntry, type_: MessageType, graph: Graph, meanings: Meanings) -> None:
        self._entry = entry
        self.view = View(type_, meanings, entry.field)
        self._inbox = Inbox(graph, entry.topic, type_, longest=MAX_TOPIC_BYTES, most=_BURST)
        self._tokens, self._at_s, self.dropped = float(_BURST), -math.inf, 0
        self._has_data = self.view.schema != _NO_DATA
        self.said = wire.Event(
            title=entry.title,
            description=entry.description or f"A message of the topic {entry.topic}, a {type_.name}.",
            semantic_type=entry.term,
            data=self.view.schema if self._has_data else None,
        )

    def occurrences(self, now_s: float) -> Iterable[bytes | None]:
        """Return the data of the events since the last call, None for one without data."""
        waiting = self._inbox.fetch()
        elapsed_s = min(max(now_s - self._at_s, 0.0), 3600.0)
        self._tokens, self._at_s = min(self._tokens + elapsed_s * self._entry.rate_hz, _BURST), now_s
        kept = waiting[: int(self._tokens)]
        self._tokens -= len(kept)
        for _ in waiting[len(kept) :]:
            self._drop(f"more than {self._entry.rate_hz:g} messages came in a second")
        return [self._data(each) for each in kept]

    def _data(self, message: Mapping[str, Any]) -> bytes | None:
        if not self._has_data:
            return None
        payload, problem = _encoded(self.view, message, MAX_EVENT_BYTES)
        if problem:
            self._drop(f"an event has no data: {problem}")
        return payload

    def _drop(self, why: str) -> None:
        self.dropped += 1
        if self.dropped.bit_count() == 1:
            _log.warning("%s: dropped (%d so far): %s", self._entry.topic, self.dropped, why)


def topic_task(entry: ActionEntry, type_: MessageType, graph: Graph, meanings: Meanings) -> tuple[Task, list[View]]:
    """Return the task that publishes its input as one message."""
    view, outlet = _input_view(entry, type_, meanings), graph.outlet(Interface(entry.topic, type_.name))

    async def run(**given: Any) -> None:
        payload = type_.write(view.message(_named(given)))
        if not outlet.has_subscribers:
            raise ValueError(f"no node listens to {entry.topic}")
        outlet.put(payload)

    said = _action(entry, view, f"Publish a message on {entry.topic}, a {type_.name}.", SERVICE_S)
    return Task(run, said, _input(view)), [view]


def service_task(entry: ActionEntry, type_: ServiceType, graph: Graph, meanings: Meanings) -> tuple[Task, list[View]]:
    """Return the task that calls a service. A response whose ``success`` is false is a failure."""
    view, response = _input_view(entry, type_.request, meanings), View(type_.response, meanings, is_object=True)
    service = Interface(entry.service, type_.name)

    async def run(**given: Any) -> Any:
        request = type_.request.write(view.message(_named(given)))
        answer = type_.response.read(await graph.call(service, request, MAX_MESSAGE_BYTES))
        if answer.get("success") is False:
            raise ValueError(answer.get("message") or f"{entry.service} has answered that it was no success")
        return response.value(answer)

    said = _action(entry, view, f"Call the service {entry.service}, a {type_.name}.", SERVICE_S, response)
    return Task(run, said, _input(view)), [view, response]


class ActionGoal:
    """An action of ROS that is an action: its input is the goal, and its id that of the goal.

    Unless it moves something, its goals go on when the agent ends, and the next run of the agent takes them up.
    """

    def __init__(self, entry: ActionEntry, client: ActionClient, meanings: Meanings) -> None:
        type_: ActionType = client.type
        self.client, self._type, self._goal = client, type_, _input_view(entry, type_.goal, meanings)
        self._feedback = View(type_.feedback, meanings, is_object=True)
        self._result = View(type_.result, meanings, is_object=True)
        self.views = [self._goal, self._feedback, self._result]
        about = f"Carry out {entry.action}, a {type_.name}."
        longest_s = MOTION_S if entry.moves else ACTION_S
        said = _action(entry, self._goal, about, longest_s, self._result, self._feedback)
        self._has_feedback = said.feedback is not None
        self._told, self.dropped = set[bytes](), 0
        self._looked_at: Mapping[bytes, int] | None = None
        resume = None if entry.moves else self._resume
        said = msgspec.structs.replace(said, resumes=resume is not None)
        self.task = Task(self._run, said, _input(self._goal), takes_call=True, resume=resume)

    def unfinished(self) -> list[str]:
        """Return the ids of goals that have become known since the last call; an earlier run may have sent them."""
        known = self.client.statuses()
        if known is self._looked_at:  # almost always: this is asked in each tick
            return []
        new = [each for each in known if each not in self._told and any(each)][:_MOST_TAKEN_UP]
        self._told = {*(self._told & known.keys()), *new}
        self._looked_at = None if len(new) == _MOST_TAKEN_UP else known
        return [str(UUID(bytes=each)) for each in new]

    async def _run(self, *, call: Call[Any], **given: Any) -> Any:
        end = await run_goal(call, self.client, self._goal.message(_named(given)), partial(self._report, call))
        return self._result.value(end.result)

    async def _resume(self, *, call: Call[Any]) -> Any:
        end = await follow_goal(call, self.client, partial(self._report, call))
        return self._result.value(end.result)

    def _report(self, call: Call[Any], said: dict[str, Any]) -> None:
        if not self._has_feedback:
            return
        _, problem = _encoded(self._feedback, said, MAX_FEEDBACK_BYTES)
        if not problem:
            call.feedback(self._feedback.value(said))
            return
        self.dropped += 1
        if self.dropped.bit_count() == 1:
            _log.warning("%s: feedback is dropped (%d so far): %s", self.client.name, self.dropped, problem)


def _encoded(view: View, message: Mapping[str, Any], most_bytes: int) -> tuple[bytes | None, str]:
    """Return the JSON of a message, and a sentence about why it cannot be sent, if so."""
    value = view.value(message)
    payload = msgspec.json.encode(value)
    if len(payload) > most_bytes:
        return None, f"{len(payload)} bytes; {most_bytes} is the maximum"
    problem = "it is unknown" if value is None else value_problem(view.schema, value)
    return (None, problem) if problem else (payload, "")


def _input_view(entry: ActionEntry, type_: MessageType, meanings: Meanings) -> View:
    view = View(type_, meanings, need="all" if entry.moves else "none", is_object=True)
    if entry.moves and view.left_out:
        raise DefinitionError(f"it moves something, and no client can state all of its input: {view.left_out[0]}")
    return view


def _action(
    entry: ActionEntry, view: View, about: str, duration_s: float, result: View | None = None,
    feedback: View | None = None,
) -> wire.Action:  # fmt: skip
    return wire.Action(
        title=entry.title,
        description=entry.description or about,
        semantic_type=entry.term,
        input=_said(view),
        feedback=_said(feedback),
        result=_said(result),
        moves=entry.moves,
        duration_s=entry.duration_s or duration_s,
        stop_s=entry.stop_s,
    )


def _said(view: View | None) -> Schema | None:
    return None if view is None or view.schema == _NO_DATA else view.schema


# Members of an input are arguments of a function, which has others: their names get a prefix.
_PREFIX = "given_"


def _input(view: View) -> type[msgspec.Struct] | None:
    if _said(view) is None:
        return None
    fields = [(_PREFIX + name, Any, UNSET) for name in view.schema.properties]
    remove: Callable[[str], str] = lambda name: name.removeprefix(_PREFIX)  # noqa: E731
    return msgspec.defstruct("Input", fields, kw_only=True, forbid_unknown_fields=True, rename=remove)


def _named(given: Mapping[str, Any]) -> dict[str, Any]:
    return {name.removeprefix(_PREFIX): value for name, value in given.items() if value is not UNSET}
