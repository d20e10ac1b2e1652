"""Components: declarations and values as a gateway reads them, and requests to an agent that has some."""

import asyncio
import itertools
import json
from collections.abc import Callable
from random import Random
from typing import Any

import msgspec
from msgspec import UNSET
from pyoxigraph import NamedNode

from component_agent import ExactRobot, Hand
from component_agent import Memory as Link
from fuzzing import mutation
from fuzzing.findings import Tally, in_process
from fuzzing.wire import spoilt
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.components.declaration import declare
from linked_fleet_agent.wire.codec import WireError, decode, decode_reply
from linked_fleet_agent.wire.components import (
    MAX_FEEDBACK_BYTES,
    MAX_RESULT_BYTES,
    Component,
    Occurrence,
    Values,
    read_declarations,
    read_value,
    without_unusable_parts,
)
from linked_fleet_agent.wire.messages import Accepted, Progress
from linked_fleet_agent.wire.schema import Schema, schema_problem, value_problem
from linked_fleet_base.errors import BadRequest, PayloadTooLarge
from linked_fleet_gateway.extensions.components.declarations import Input
from linked_fleet_gateway.extensions.components.offers import read_json
from linked_fleet_gateway.extensions.components.places import place_of
from linked_fleet_gateway.extensions.components.state import RobotState
from linked_fleet_gateway.http.invoke import MAX_TRIPLES
from linked_fleet_rdf.graph import Graph

_TERM, _FOCUS = "http://example.org/r/vocabulary#hand-input-x", NamedNode("http://example.org/r/hand/actions/x")
_SCHEMAS: tuple[dict[str, Any], ...] = (
    {"type": "number", "unit": "M", "minimum": 0, "maximum": 0.08, "default": 0.04, "title": "Width"},
    {"type": "integer", "enum": [1, 2, 3]},
    {"type": "string", "maxLength": 9, "pattern": "^[A-Z]{2}-[0-9]{1,4}$"},
    {"type": "array", "items": {"type": "boolean"}, "minItems": 1, "maxItems": 3},
    {"type": "object", "properties": {"a": {"type": "number"}, "b": {"type": "string"}}, "required": ["a"]},
)
_VALUES: tuple[Any, ...] = (0.03, 2, "AB-12", [True, False], {"a": 1, "b": "x"})
_HAND = declare(Hand()).said
_DECLARED = msgspec.json.encode(_HAND)
_LINKS, _JOINTS = {"base"}, {"arm", "finger"}
_INPUTS: tuple[tuple[dict[str, Any], Any], ...] = (
    ({"action": "grasp"}, {"force": 20}), ({"action": "release"}, {}), ({"action": "roll"}, None),
    ({"action": "think"}, None), ({"action": "last"}, {"seconds": 2}), ({"property": "light"}, True),
)  # fmt: skip


def run(count: int, seed: int, first: int = 0) -> Tally:
    loop = asyncio.new_event_loop()
    try:
        return in_process("components", count, seed, first, lambda: World(loop).take)
    finally:
        loop.run_until_complete(_end_tasks())
        loop.close()


async def _end_tasks() -> None:
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


class World:
    """An agent with a hand, for one episode."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        loop.run_until_complete(_end_tasks())
        self._now_ns, self._ids = 10**12, itertools.count()
        self._heard: RobotState | None = None
        self._link = Link()
        self._agent = Agent(
            "r", ExactRobot(Hand()), monotonic_ns=lambda: self._now_ns, wall_ns=lambda: self._now_ns + 10**18
        )
        self._tick()

    def take(self, random: Random) -> None:
        random.choice(_CASES)(self, random)

    def declaration(self, random: Random) -> None:
        """Whatever is declared is refused with a sentence, or can be used and costs no more than its bounds."""
        said = json.loads(_DECLARED)
        said["properties"]["more"] = {"schema": json.loads(json.dumps(random.choice(_SCHEMAS)))}
        accepted, refused = read_declarations(spoilt(random, [said]), _LINKS, _JOINTS)
        assert all(refused), "what is refused is told why"
        for component in accepted:
            _use(random, component)

    def value(self, random: Random) -> None:
        """A value conforms, or violates its schema with a sentence."""
        index = random.randrange(len(_SCHEMAS))
        schema = msgspec.convert(_SCHEMAS[index], Schema)
        value, said = read_value(schema, spoilt(random, [json.loads(json.dumps(_VALUES[index]))])[1:-1] or b"x")
        assert value is None or not said, "a value is taken or refused"
        assert value is None or not value_problem(schema, value), "a value that is taken conforms"

    def message(self, random: Random) -> None:
        """Messages of agents decode, or are refused."""
        values = {"hand": {"at_ns": 1, "values": {"width": 0.5, "light": None}, "fault": "no bus"}}
        common = {"version": 2, "incarnation": 1, "sequence": 1, "monotonic_ns": 1, "wall_ns": 1}
        event = {"component": "hand", "event": "dropped", "data": {"at": 1}}
        kind, more = random.choice(((Values, {"components": values}), (Occurrence, event)))
        try:
            decode(spoilt(random, common | more), kind)
        except WireError as error:
            assert str(error)

    def receipt(self, random: Random) -> None:
        """A gateway takes what conforms, and says in sentences what it refuses."""
        self._heard = self._heard or RobotState([_HAND], 1)
        values = {"hand": {"at_ns": 1, "values": {"width": random.random(), "light": random.random() < 0.5}}}
        common = {"version": 2, "incarnation": 1, "sequence": next(self._ids), "monotonic_ns": 1, "wall_ns": 1}
        event = {"component": "hand", "event": "dropped", "data": {"at": 1}}
        try:
            if random.random() < 0.5:
                said = decode(spoilt(random, common | {"components": values}), Values)
                changes, refused = (self._heard.hear if random.random() < 0.8 else self._heard.hear_all)(said)
                assert all(refused), "what is refused is told why"
                assert all(name == "hand" for name, _ in changes)
            else:
                self._heard.happen(decode(spoilt(random, common | event), Occurrence))
        except WireError as error:
            assert str(error)
        if random.random() < 0.05:
            list(self._heard.expire(random.randrange(10**12)))
        state = self._heard.components["hand"]
        for name, value in state.values.items():
            schema = state.declared.properties[name].schema
            assert value is None or not value_problem(schema, value), "a value that is kept conforms"

    def input(self, random: Random) -> None:
        """The shape of an input takes what conforms to its schema, and nothing else."""
        index = random.randrange(len(_SCHEMAS))
        schema = msgspec.convert({"type": "object", "properties": {"a": _SCHEMAS[index]}}, Schema)
        taken, graph = Input(place_of(schema, _TERM)), Graph()
        try:
            given = read_json(spoilt(random, {"a": json.loads(json.dumps(_VALUES[index]))}), MAX_TRIPLES)
        except (BadRequest, PayloadTooLarge) as error:
            assert str(error)
            return
        if not isinstance(given, dict):
            return
        taken.describe(graph, _FOCUS, given)
        value, refused = taken.read(graph.triples, _FOCUS)
        assert (refused is None) == (not value_problem(schema, given)), given
        assert refused is None or refused[0], "a refusal has a sentence"
        assert refused is not None or not value_problem(schema, value)

    def result(self, random: Random) -> None:
        """Whatever an action returns is kept as it is, or the progress is refused."""
        said = {
            "version": 1, "id": "a", "incarnation": 1, "state": "succeeded", "wall_ns": 1,
            "result": json.loads(json.dumps(random.choice(_VALUES))), "feedback": mutation.value(random),
        }  # fmt: skip
        try:
            progress, _ = without_unusable_parts(decode(spoilt(random, said), Progress))
        except WireError as error:
            assert str(error)
            return
        for part, most in ((progress.feedback, MAX_FEEDBACK_BYTES), (progress.result, MAX_RESULT_BYTES)):
            assert part is UNSET or len(msgspec.json.encode(msgspec.json.decode(part))) <= 2 * most

    def operate(self, random: Random) -> None:
        """The agent answers every request, and goes on."""
        what, given = random.choice(_INPUTS)
        request = {
            "version": 2, "id": f"a-{next(self._ids)}", "incarnation": self._agent.incarnation, "component": "hand",
            "seen_ns": self._now_ns - 1, "time_to_live_ns": 10**9, "action": "", "property": "", "input": given,
            "rehearsal": random.random() < 0.1,
        }  # fmt: skip
        payload = spoilt(random, json.loads(json.dumps(request | what)))

        async def ask() -> None:
            reply = decode_reply(self._agent.handle_operate(payload))
            assert isinstance(reply, Accepted) or reply.reason

        self._loop.run_until_complete(ask())
        self._tick(random.choice((1, 1, 10, 100)))

    def stop(self, random: Random) -> None:
        """A stop ends what moves."""
        stop = {"version": 1, "id": f"s-{next(self._ids)}", "joints": random.choice(([], ["finger"]))}

        async def ask() -> None:
            decode_reply(self._agent.handle_stop(json.dumps(stop).encode()))

        self._loop.run_until_complete(ask())
        self._tick(60)
        said = [each.state for each in self._link.progress if each.id == stop["id"]]
        assert said[-1] == "succeeded", "a stop succeeds, because the actions of the hand end"

    def _tick(self, times: int = 1) -> None:
        async def tick() -> None:
            for _ in range(times):
                self._now_ns += 10_000_000
                self._agent.tick(self._link)
                await asyncio.sleep(0)

        self._loop.run_until_complete(tick())
        del self._link.states[:-1], self._link.progress[:-50], self._link.values[:-1], self._link.conditions[:-1]


def _use(random: Random, component: Component) -> None:
    for each in component.properties.values():
        assert not schema_problem(each.schema)
        value_problem(each.schema, mutation.value(random))


_CASES: tuple[Callable[[World, Random], None], ...] = (
    World.declaration, World.declaration, World.value, World.message, World.operate, World.operate, World.stop,
    World.receipt, World.receipt, World.receipt, World.input, World.result,
)  # fmt: skip
