"""Topics, services and actions of real nodes as parts of a robot, by both transports."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from component_agent import Bench, ExactRobot
from linked_fleet_agent.robots.ros2.configuration import read_configuration
from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.describing import Describing
from linked_fleet_agent.robots.ros2.exposure import expose
from linked_fleet_agent.robots.ros2.graph import Graph
from linked_fleet_agent.robots.ros2.session import RosSession
from linked_fleet_agent.robots.ros2.types import MessageTypes
from ros_peers import SOURCES, behind_bridge, on_humble, on_rmw_zenoh
from running import eventually

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

GOAL = "00010203-0405-0607-0809-0a0b0c0d0e0f"
NAMES = ("/lamp", "/set_lamp", "/home", "/fibonacci/_action/send_goal", "/fibonacci/_action/status", "/battery_state")


@asynccontextmanager
async def joined(where: str, bridged: bool, distro: str = "") -> AsyncIterator[tuple[Graph, MessageTypes]]:
    """Yield the graph of a robot, as soon as all of it is there."""
    types = MessageTypes([SOURCES / "interfaces_of_tests"], preferred=distro)

    def hash_of(name: str) -> str:
        try:
            return types.message(name).hash
        except DefinitionError:
            return ""

    session = RosSession(where, 0, "linked_fleet_agent", hash_of, bridged)
    try:
        await asyncio.to_thread(eventually, lambda: _has_all(session), "what the robot offers")
        yield session, types
    finally:
        session.close()


def _has_all(session: RosSession) -> bool:
    return {each.interface.name for each in session.offers()}.issuperset(NAMES)


class Client:
    def __init__(self, bench: Bench) -> None:
        self.bench = bench

    async def until(self, condition: Callable[[], Any]) -> None:
        async with asyncio.timeout(60):
            while not condition():
                await self.bench.tick()
                await asyncio.sleep(0.01)

    async def operate(self, id: str, action: str, given: object = None) -> Any:
        self.bench.operate(id, action, given, component="ros")
        await self.until(lambda: self.ended(id))
        return self.bench.end(id)

    def ended(self, id: str) -> bool:
        return bool({"succeeded", "failed", "cancelled"} & set(self.bench.states(id)))

    def value(self, name: str) -> bytes:
        found = b""
        for message in self.bench.link.values:
            if "ros" in message.components and name in message.components["ros"].values:
                found = bytes(message.components["ros"].values[name])
        return found


async def _use(where: str, bridged: bool, distro: str = "") -> None:
    async with joined(where, bridged, distro) as (graph, types):
        made = await expose(graph, types, read_configuration(None, expose=["/*"]))
        root = next(each for each in made.components if each.name == "ros")
        said = root.declaration().said
        assert {"lamp", "battery_state"} <= said.properties.keys()
        assert {"set_lamp", "home", "fibonacci"} <= said.actions.keys()
        client = Client(Bench(other=ExactRobot(root)))
        await client.until(lambda: client.value("lamp") == b"false")  # latched before we came
        await client.until(lambda: b'"voltage"' in client.value("battery_state"))
        lit = await client.operate("a", "set_lamp", {"data": True})
        assert (lit.state, bytes(lit.result)) == ("succeeded", b'{"success":true,"message":"switched"}')
        await client.until(lambda: client.value("lamp") == b"true")
        counted = await client.operate(GOAL, "fibonacci", {"order": 5})
        assert (counted.state, bytes(counted.result)) == ("succeeded", b'{"sequence":[0,1,1,2,3]}')
        assert bytes(counted.feedback).startswith(b'{"sequence":[0,1')
        refused = await client.operate("00010203-0405-0607-0809-0a0b0c0d0eff", "fibonacci", {"order": -1})
        assert (refused.state, refused.reason) == ("failed", "/fibonacci does not accept the goal")
        await _cancel(client, "00010203-0405-0607-0809-0a0b0c0d0e11")


async def _cancel(client: Client, id: str) -> None:
    client.bench.operate(id, "fibonacci", {"order": 1000}, component="ros")
    await client.until(lambda: any(each.id == id and each.feedback for each in client.bench.link.progress))
    client.bench.stop("s", command=id)
    await client.until(lambda: client.ended(id))
    assert client.bench.end(id).state == "cancelled"


async def test_what_is_exposed_works_over_rmw_zenoh() -> None:
    with on_rmw_zenoh() as where:
        await _use(where, bridged=False)


async def test_what_is_exposed_works_with_nodes_that_state_no_hashes() -> None:
    with on_humble() as where:
        await _use(where, bridged=False, distro="humble")


async def test_what_is_exposed_works_behind_the_bridge() -> None:
    with behind_bridge() as where:
        await _use(where, bridged=True)


async def test_a_node_describes_its_types_as_the_store_has_them() -> None:
    with on_rmw_zenoh() as where:
        async with joined(where, bridged=False) as (graph, known):
            for name in ("sensor_msgs/msg/BatteryState", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"):
                types, hash_ = MessageTypes(), known.message(name).hash
                await Describing(graph, types).describe(name, "/x", {name: hash_})
                described = types._described[name, hash_]
                assert all(described.definitions[each].fields for each in described.definitions)
                payload = known.message(name).write({})
                assert described.serializer.read(payload, name) == known.message(name).read(payload)
