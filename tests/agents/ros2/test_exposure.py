"""What clients get of topics, services and actions of a ROS graph: their agent is real, the graph is in memory."""

import asyncio
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from component_agent import Bench, ExactRobot
from linked_fleet_agent.motion import State
from linked_fleet_agent.robots.ros2.configuration import Configuration, read_configuration
from linked_fleet_agent.robots.ros2.exposure import Exposed, expose
from linked_fleet_agent.robots.ros2.goals import ABORTED, CANCELED, EXECUTING, goal_id_of
from linked_fleet_agent.robots.ros2.types import GET_TYPE_DESCRIPTION, MessageTypes
from linked_fleet_agent.wire.components import Values
from linked_fleet_agent.wire.messages import Accepted, Refused
from memory_ros import MemoryAction, MemoryGraph

pytestmark = pytest.mark.virtual

FIBONACCI = "test_msgs/action/Fibonacci"
ID = "00010203-0405-0607-0809-0a0b0c0d0e0f"
GOAL = bytes(range(16))
FILES = {
    "test_msgs/action/Fibonacci.action": "int32 order\n---\nint32[] sequence\n---\nint32[] sequence",
    "test_msgs/msg/Lamp.msg": "bool on\nfloat32 level\nstring name",
    "test_msgs/action/Move.action": (
        "float64 x\n---\nint32 STUCK=3\nint32 error_code\nstring error_string\n---\nfloat64 remaining"
    ),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        file = tmp_path / "types" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return tmp_path / "types"


@pytest.fixture
def graph(folder: Path) -> MemoryGraph:
    return MemoryGraph(MessageTypes([folder]), hashes=True, patience_s=5.0)


@pytest.fixture
def configured(tmp_path: Path) -> Callable[[str], Configuration]:
    def read(text: str) -> Configuration:
        (tmp_path / "robot.toml").write_text(text)
        return read_configuration(tmp_path / "robot.toml")

    return read


def newest(server: MemoryAction) -> bytes:
    return list(server.goals)[-1]


async def exposed(graph: MemoryGraph, configuration: Configuration, **more: Any) -> Exposed:
    return await expose(graph, graph.types, configuration, joints=["arm", "finger"], **more)


class Client:
    """A client of an agent with what is exposed."""

    def __init__(self, made: Exposed) -> None:
        self.bench = Bench(other=ExactRobot(*made.components))
        self.made = made

    async def run(self, seconds: float = 0.2) -> None:
        for _ in range(round(seconds / 0.01)):
            await self.bench.tick()
            await asyncio.sleep(0.01)

    async def until(self, condition: Callable[[], Any], seconds: float = 60.0) -> None:
        for _ in range(round(seconds / 0.01)):
            if condition():
                return
            await self.run(0.01)
        raise AssertionError("it did not come about")

    async def operate(self, component: str, action: str, given: object = None, id: str = ID) -> Accepted | Refused:
        return self.bench.operate(id, action, given, component=component)  # type: ignore[return-value]

    async def set(self, component: str, name: str, given: object, id: str = ID) -> None:
        reply = self.bench.operate(id, "", given, component=component, property=name)
        assert isinstance(reply, Accepted), reply

    def values(self, component: str) -> dict[str, bytes]:
        found: dict[str, bytes] = {}
        message: Values
        for message in self.bench.link.values:
            if component in message.components:
                found |= {name: bytes(each) for name, each in message.components[component].values.items()}
        return found

    def events(self) -> list[tuple[str, bytes]]:
        return [(f"{each.component}.{each.event}", bytes(each.data or b"")) for each in self.bench.link.events]

    def end(self, id: str = ID) -> Any:
        return self.bench.end(id)

    def state(self, id: str = ID) -> State | None:
        found = self.bench.states(id)
        return found[-1] if found else None  # type: ignore[return-value]


async def test_a_topic_is_a_property_that_is_unknown_without_news(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    topic = ("/oven/temperature", "sensor_msgs/msg/Temperature")
    graph.offer("publisher", *topic)
    made = await exposed(graph, configured('[[property]]\ntopic = "/oven/temperature"\nfield = "temperature"'))
    said = made.components[0].declaration().said
    assert (said.name, said.properties["temperature"].schema.unit, made.findings) == ("oven", "DEG_C", [])
    client = Client(made)
    await client.run()
    assert client.values("oven") == {}
    graph.publish(*topic, {"temperature": 200.5})
    await client.run()
    assert client.values("oven") == {"temperature": b"200.5"}
    graph.publish(*topic, {"temperature": math.nan})
    await client.run()
    assert client.values("oven") == {"temperature": b"null"}
    graph.publish(*topic, {"temperature": 201.0})
    await client.run()
    graph.publish(*topic, b"\0\1\0\0broken")
    await client.run(4.0)
    assert client.values("oven") == {"temperature": b"201.0"}
    await client.run(2.0)
    assert client.values("oven") == {"temperature": b"null"}, "five seconds without a message"


async def test_a_latched_topic_is_known_as_long_as_its_publisher_is_there(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    graph.publish("/mode", "std_msgs/msg/String", {"data": "automatic"}, latched=True)
    client = Client(await exposed(graph, configured('[[property]]\ntopic = "/mode"')))
    await client.run(30.0)
    assert client.values("ros") == {"mode": b'"automatic"'}
    graph.leave("/mode")
    await client.run(6.0)
    assert client.values("ros") == {"mode": b"null"}


async def test_a_property_that_can_be_set_publishes_its_value(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    listening = graph.offer("subscription", "/lamp/level", "std_msgs/msg/Float64")
    client = Client(await exposed(graph, configured('[[property]]\ntopic = "/lamp/level"\nwrite = true')))
    await client.set("lamp", "level", 0.5)
    await client.until(lambda: client.state() == "succeeded")
    assert graph.outlets[listening].said == [{"data": 0.5}]
    await client.run()
    assert client.values("lamp") == {"level": b"0.5"}
    graph.leave("/lamp/level")
    await client.set("lamp", "level", 0.7, id="b")
    await client.until(lambda: client.state("b") == "failed")
    assert client.end("b").reason == "no node listens to /lamp/level"
    reply = client.bench.operate("c", "", "bright", component="lamp", property="level")
    assert isinstance(reply, Refused) and "is not a number" in reply.reason


async def test_all_of_a_message_must_be_set(graph: MemoryGraph, configured: Callable[[str], Configuration]) -> None:
    graph.offer("subscription", "/lamp/state", "test_msgs/msg/Lamp")
    client = Client(await exposed(graph, configured('[[property]]\ntopic = "/lamp/state"\nwrite = true')))
    reply = client.bench.operate("a", "", {"on": True}, component="lamp", property="state")
    assert isinstance(reply, Refused) and "'level' is missing" in reply.reason


async def test_messages_of_a_topic_are_events(graph: MemoryGraph, configured: Callable[[str], Configuration]) -> None:
    bumper, ping = ("/bumper/hit", "test_msgs/msg/Lamp"), ("/ping", "std_msgs/msg/Empty")
    graph.offer("publisher", *bumper)
    graph.offer("publisher", *ping)
    client = Client(
        await exposed(graph, configured('[[event]]\ntopic = "/bumper/hit"\nfield = "name"\n[[event]]\ntopic = "/ping"'))
    )
    graph.publish(*bumper, {"name": "left"})
    graph.publish(*bumper, {"name": "right"})
    graph.publish(*ping, {})
    await client.run()
    assert client.events() == [("bumper.hit", b'"left"'), ("bumper.hit", b'"right"'), ("ros.ping", b"")]


async def test_a_flood_of_events_costs_its_topic_alone(
    graph: MemoryGraph, configured: Callable[[str], Configuration], caplog: pytest.LogCaptureFixture
) -> None:
    flood, ping = ("/flood", "std_msgs/msg/Int32"), ("/ping", "std_msgs/msg/Empty")
    graph.offer("publisher", *flood)
    graph.offer("publisher", *ping)
    client = Client(await exposed(graph, configured('[[event]]\ntopic = "/flood"\n[[event]]\ntopic = "/ping"')))
    for round_ in range(200):
        for number in range(50):
            graph.publish(*flood, {"data": number})
        if round_ % 40 == 0:
            graph.publish(*ping, {})
        await client.run(0.01)
    names = [name for name, _ in client.events()]
    assert names.count("ros.ping") == 5
    assert names.count("ros.flood") <= 16 + 2 * 10 + 1
    assert len([each for each in caplog.records if "/flood: dropped" in each.message]) <= 12


async def test_an_event_whose_data_are_too_long_or_unknown_has_none(
    graph: MemoryGraph, configured: Callable[[str], Configuration], caplog: pytest.LogCaptureFixture
) -> None:
    lamp, number = ("/lamp", "test_msgs/msg/Lamp"), ("/number", "std_msgs/msg/Float32")
    for each in (lamp, number):
        graph.offer("publisher", *each)
    client = Client(await exposed(graph, configured('[[event]]\ntopic = "/lamp"\n[[event]]\ntopic = "/number"')))
    graph.publish(*lamp, {"name": "x" * 17_000})
    graph.publish(*number, {"data": math.nan})
    graph.publish(*number, {"data": 0.5})
    await client.run()
    assert client.events() == [("ros.lamp", b""), ("ros.number", b""), ("ros.number", b"0.5")]
    assert "bytes; 16384 is the maximum" in caplog.text
    assert "an event has no data: it is unknown" in caplog.text


async def test_feedback_that_is_too_long_is_dropped_and_costs_few_lines(
    graph: MemoryGraph, configured: Callable[[str], Configuration], caplog: pytest.LogCaptureFixture
) -> None:
    server = MemoryAction(graph, "/cell/count", FIBONACCI)
    client = Client(await exposed(graph, configured('[[action]]\naction = "/cell/count"')))
    await client.operate("cell", "count", {"order": 5})
    await client.until(lambda: server.goals)
    for _ in range(20):
        server.tell(GOAL, sequence=[1_000_000_000] * 2000)
        await client.run(0.1)
    server.tell(GOAL, sequence=[7])
    await client.run()
    assert bytes(client.end().feedback) == b'{"sequence":[7]}'
    assert 0 < len([each for each in caplog.records if "feedback is dropped" in each.message]) <= 5


async def test_a_service_is_an_action_that_moves_nothing(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    lit: list[bool] = []

    def answer(request: Any) -> dict[str, Any]:
        lit.append(request["data"])
        return {"success": request["data"], "message": "" if request["data"] else "it is hot"}

    graph.serve("/lamp/switch", "std_srvs/srv/SetBool", answer)
    client = Client(await exposed(graph, configured('[[action]]\nservice = "/lamp/switch"')))
    assert client.made.components[0].declaration().said.actions["switch"].moves == ()
    await client.operate("lamp", "switch", {"data": True}, id="a")
    await client.until(lambda: client.state("a") == "succeeded")
    assert bytes(client.end("a").result) == b'{"success":true,"message":""}'
    await client.operate("lamp", "switch", None, id="b")
    await client.until(lambda: client.state("b") == "failed")
    assert client.end("b").reason == "it is hot" and lit == [True, False]


async def test_a_service_without_a_server_fails_with_the_reason(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    text = '[[action]]\nservice = "/lamp/blink"\ntype = "std_srvs/srv/Trigger"\nduration_s = 3'
    client = Client(await exposed(graph, configured(text)))
    await client.operate("lamp", "blink", id="a")
    await client.until(lambda: client.state("a") == "failed")
    assert client.end("a").reason == "no node offers the service /lamp/blink"
    graph.serve("/lamp/blink", "std_srvs/srv/Trigger", lambda asked: None)
    await client.operate("lamp", "blink", id="b")
    await client.until(lambda: client.state("b") == "failed")
    assert client.end("b").reason == "it did not end within the 3 s that it may take"


async def test_a_topic_can_be_an_action_that_moves_something(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    door = graph.offer("subscription", "/door/open", "std_msgs/msg/Bool")
    client = Client(await exposed(graph, configured('[[action]]\ntopic = "/door/open"\nmoves = ["base"]')))
    reply = await client.operate("door", "open", {}, id="a")
    assert isinstance(reply, Refused) and "'data' is missing" in reply.reason
    await client.operate("door", "open", {"data": True}, id="b")
    await client.until(lambda: client.state("b") == "succeeded")
    assert graph.outlets[door].said == [{"data": True}]


async def test_an_action_has_feedback_and_a_result(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    server = MemoryAction(graph, "/cell/count", FIBONACCI)
    client = Client(await exposed(graph, configured('[[action]]\naction = "/cell/count"')))
    await client.operate("cell", "count", {"order": 5})
    await client.until(lambda: server.goals)
    assert server.goals == {GOAL: {"order": 5}} and goal_id_of(ID) == GOAL, "so that the goal can be found again"
    server.tell(GOAL, sequence=[0, 1])
    await client.run()
    assert bytes(client.end().feedback) == b'{"sequence":[0,1]}' and client.state() == "running"
    await client.run(30.0)
    server.end(newest(server), sequence=[0, 1, 1, 2, 3])
    await client.until(lambda: client.state() == "succeeded")
    assert bytes(client.end().result) == b'{"sequence":[0,1,1,2,3]}'


async def test_a_goal_that_the_server_refuses_or_aborts_fails_with_its_reason(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    server = MemoryAction(graph, "/base/move", "test_msgs/action/Move")
    client = Client(await exposed(graph, configured('[[action]]\naction = "/base/move"\nmoves = ["base"]')))
    server.accepts = False
    await client.operate("base", "move", {"x": 1.0}, id="a")
    await client.until(lambda: client.state("a") == "failed")
    assert client.end("a").reason == "/base/move does not accept the goal"
    server.accepts = True
    await client.operate("base", "move", {"x": 1.0}, id="b")
    await client.until(lambda: server.goals)
    server.end(newest(server), ABORTED, error_code=3, error_string="a wheel is blocked")
    await client.until(lambda: client.state("b") == "failed")
    assert client.end("b").reason == "it was given up by the robot: error 3, STUCK (a wheel is blocked)"
    await client.operate("base", "move", {"x": 1.0}, id="c")
    await client.until(lambda: len(server.goals) == 2)
    server.end(newest(server), CANCELED)
    await client.until(lambda: client.state("c") == "failed")
    assert client.end("c").reason == "it was cancelled by another client of ROS"
    graph.serve("/base/move/_action/send_goal", server.type.send_goal.name, lambda asked: None)
    await client.operate("base", "move", {"x": 1.0}, id="d")
    await client.until(lambda: client.state("d") == "failed")
    assert client.end("d").reason == "/base/move does not answer"


async def test_a_stop_cancels_the_goal_and_waits_for_its_end(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    server = MemoryAction(graph, "/base/move", "test_msgs/action/Move")
    made = await exposed(graph, configured('[[action]]\naction = "/base/move"\nmoves = ["base"]\nstop_s = 2'))
    assert [each.name for each in made.moving] == ["/base/move"]
    client = Client(made)
    await client.operate("base", "move", {"x": 1.0})
    await client.until(lambda: server.goals)
    server.ends_when_cancelled = False
    client.bench.stop("s")
    await client.run(1.5)
    assert client.state() == "running"
    await client.run(1.0)
    assert "was told to end" in client.bench.link.conditions[-1].fault
    server.ends_when_cancelled = True
    await client.until(lambda: client.state() == "cancelled", 2.0)
    assert list(server.statuses.values()) == [CANCELED]


async def test_a_result_survives_a_restart_of_what_is_between(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    server = MemoryAction(graph, "/cell/count", FIBONACCI)
    client = Client(await exposed(graph, configured('[[action]]\naction = "/cell/count"')))
    await client.operate("cell", "count", {"order": 5})
    await client.until(lambda: server.goals)
    await client.run(20.0)
    graph.cut = True
    await client.run(3.0)
    server.end(newest(server), sequence=[1])
    await client.run(3.0)
    graph.heal()
    await client.until(lambda: client.state() == "succeeded")
    assert bytes(client.end().result) == b'{"sequence":[1]}'


async def test_the_next_agent_tells_how_a_goal_ends(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    server = MemoryAction(graph, "/cell/count", FIBONACCI)
    configuration = configured('[[action]]\naction = "/cell/count"')
    first = Client(await exposed(graph, configuration))
    await first.operate("cell", "count", {"order": 5})
    await first.until(lambda: server.goals)
    run = asyncio.ensure_future(first.bench.agent.run(first.bench.link))
    await asyncio.sleep(0.1)
    run.cancel()
    await asyncio.wait({run})
    await asyncio.sleep(5.0)
    assert first.state() == "running" and list(server.statuses.values()) == [EXECUTING], "it goes on"
    second = Client(await exposed(graph, configuration))
    await second.until(lambda: second.state() == "running")
    await second.run()
    server.tell(GOAL, sequence=[0, 1])
    await second.run()
    assert bytes(second.end().feedback) == b'{"sequence":[0,1]}'
    server.end(GOAL, sequence=[0, 1, 1])
    await second.until(lambda: second.state() == "succeeded")
    assert bytes(second.end().result) == b'{"sequence":[0,1,1]}'
    third = Client(await exposed(graph, configuration))
    await third.until(lambda: third.state() == "succeeded")
    await third.run(1.0)
    assert third.bench.states(ID) == ["running", "succeeded"], "it is told once by each agent"


async def test_a_goal_that_moves_something_ends_with_its_agent(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    server = MemoryAction(graph, "/base/move", "test_msgs/action/Move")
    client = Client(await exposed(graph, configured('[[action]]\naction = "/base/move"\nmoves = ["base"]')))
    await client.operate("base", "move", {"x": 1.0})
    await client.until(lambda: server.goals)
    run = asyncio.ensure_future(client.bench.agent.run(client.bench.link))
    await asyncio.sleep(0.1)
    run.cancel()
    await asyncio.wait({run})
    await asyncio.sleep(1.0)
    assert list(server.statuses.values()) == [CANCELED]


async def test_a_stop_while_the_server_has_not_yet_answered_cancels_the_goal_too(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    server = MemoryAction(graph, "/base/move", "test_msgs/action/Move")
    accept = server._accept

    async def slowly(request: bytes) -> bytes:
        said = accept(server.type.send_goal.request.read(request))
        await asyncio.sleep(1.0)
        return server.type.send_goal.response.write(said)

    graph.serve_bytes("/base/move/_action/send_goal", server.type.send_goal.name, slowly)
    client = Client(await exposed(graph, configured('[[action]]\naction = "/base/move"\nmoves = ["base"]')))
    await client.operate("base", "move", {"x": 1.0})
    await client.until(lambda: server.goals)
    client.bench.stop("s")
    await client.until(lambda: client.state() == "cancelled")
    assert list(server.statuses.values()) == [CANCELED]


async def counting(graph: MemoryGraph, configured: Callable[[str], Configuration]) -> tuple[MemoryAction, Client]:
    """Return a server that has accepted a goal, and the client that asked for it."""
    server = MemoryAction(graph, "/cell/count", FIBONACCI)
    client = Client(await exposed(graph, configured('[[action]]\naction = "/cell/count"')))
    await client.operate("cell", "count", {"order": 5})
    await client.until(lambda: server.goals)
    return server, client


lost = pytest.mark.parametrize("lose", [MemoryAction.forget, lambda server: server.graph.leave(*server.names)])


@lost
async def test_a_lost_server_makes_the_result_unknown(
    graph: MemoryGraph, configured: Callable[[str], Configuration], lose: Callable[[MemoryAction], None]
) -> None:
    server, client = await counting(graph, configured)
    lose(server)
    await client.until(lambda: client.state() == "failed", 30.0)
    assert client.end().reason.startswith("what became of the goal is not known")


@lost
async def test_a_goal_that_is_cancelled_after_its_server_was_lost_is_not_called_cancelled(
    graph: MemoryGraph, configured: Callable[[str], Configuration], lose: Callable[[MemoryAction], None]
) -> None:
    server, client = await counting(graph, configured)
    lose(server)
    client.bench.stop("s", command=ID)
    await client.until(lambda: client.state() in ("failed", "cancelled"), 30.0)
    assert client.state() == "failed"
    assert client.end().reason.startswith("it was cancelled, and what became of the goal is not known: ")


async def test_a_refused_goal_is_one_line_in_the_log(
    graph: MemoryGraph, configured: Callable[[str], Configuration], caplog: pytest.LogCaptureFixture
) -> None:
    MemoryAction(graph, "/cell/count", FIBONACCI).accepts = False
    client = Client(await exposed(graph, configured('[[action]]\naction = "/cell/count"')))
    await client.operate("cell", "count", {"order": 5})
    await client.until(lambda: client.state() == "failed")
    (said,) = [each for each in caplog.records if "accept" in each.getMessage()]
    assert said.getMessage() == "cell.count failed: /cell/count does not accept the goal"
    assert (said.levelname, said.exc_info) == ("WARNING", None)


async def test_what_is_missing_is_said_and_comes_later(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    configuration = configured('[[property]]\ntopic = "/lamp/on"\n[[property]]\ntopic = "/mode"')
    graph.offer("publisher", "/mode", "std_msgs/msg/String")
    made = await exposed(graph, configuration)
    assert [each.name for each in made.components] == ["ros"]
    assert made.findings == ["the topic /lamp/on is not there, and the configuration does not state its type"]
    assert not made.lacks(configuration, graph.offers())
    graph.offer("publisher", "/lamp/on", "std_msgs/msg/Bool")
    assert not made.lacks(configuration, graph.offers()), "it may go again at once"
    assert made.lacks(configuration, graph.offers())
    again = await exposed(graph, configuration)
    assert [each.name for each in again.components] == ["lamp", "ros"] and again.findings == []
    graph.cut = True
    assert not again.lacks(configuration, graph.offers()), "what has left stays declared, and is unknown"


async def test_a_type_that_only_its_node_knows_is_described_by_it(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    graph.offer("publisher", "/lamp/state", "test_msgs/msg/Lamp")
    MemoryAction(graph, "/lamp/count", FIBONACCI)
    graph.describe_types("/lamp/node", graph.types)
    graph.describe_types("/other", MessageTypes())
    configuration = read_configuration(None, expose=["/lamp/*"])
    made = await expose(graph, MessageTypes(), configuration)
    said = made.components[0].declaration().said
    assert list(said.properties["state"].schema.properties) == ["on", "level", "name"]
    assert said.actions["count"].result is not None
    assert made.findings == [] and graph.calls[0][0] == "/lamp/node/get_type_description"


HASH = f"RIHS01_{'0' * 64}"


async def test_nodes_that_do_not_describe_types_cost_a_bounded_time(graph: MemoryGraph) -> None:
    """A hundred types and forty nodes, which are silent or refuse: each silent one is waited for once."""
    for number in range(100):
        graph.offer("publisher", f"/lamp/t{number}", f"test_msgs/msg/Lamp{number}", type_hash=HASH)
    for number in range(20):
        graph.serve(f"/lamp/n{number}/get_type_description", GET_TYPE_DESCRIPTION, lambda _: None)
        graph.serve(f"/lamp/r{number}/get_type_description", GET_TYPE_DESCRIPTION, lambda _: {"successful": False})
    begun_s = time.monotonic()
    made = await expose(graph, MessageTypes(), read_configuration(None, expose=["/lamp/t*"]))
    assert made.components == [] and len(made.findings) == 100
    assert time.monotonic() - begun_s < 30.0
    silent = [name for name, _ in graph.calls if name.startswith("/lamp/n")]
    assert len(silent) == len(set(silent))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[property]]\ntopic = "/lamp/state"', "/lamp/state is left out: the type test_msgs/msg/Lamp is not known"),
        ('[[property]]\ntopic = "/a"\ntype = "std_msgs/msg/Bool"\nfield = "x"', "std_msgs/msg/Bool has no field 'x'"),
        ('[[property]]\ntopic = "/a"\ntype = "x/msg/Y"', "its peers do not state a hash, so no node can describe it"),
        (
            '[[action]]\naction = "/a"\ntype = "control_msgs/action/FollowJointTrajectory"\nmoves = ["arm"]',
            "no client can state all of its input: trajectory.points: it is nested more than 4 deep",
        ),
        (
            '[[action]]\nservice = "/a"\ntype = "std_srvs/srv/Empty"\nmoves = ["leg"]',
            "moves 'leg', which is neither a joint of the robot nor 'base'",
        ),
        (
            '[[property]]\ntopic = "/battery/on"\ntype = "std_msgs/msg/Bool"',
            "the driver has a component 'battery' itself",
        ),
        (
            '[[property]]\ntopic = "/a"\ntype = "std_msgs/msg/Bool"\n[component.ros]\nlink = "nose"',
            "its link 'nose' is none of the robot's",
        ),
        (
            '[[property]]\ntopic = "/a"\ntype = "std_msgs/msg/Bool"\n'
            '[component.ros]\nkind = "https://w3id.org/linked-fleet#Gripper"',
            "component 'ros' is left out",
        ),
    ],
)
async def test_what_cannot_be_a_part_is_left_out_with_the_reason(
    graph: MemoryGraph, configured: Callable[[str], Configuration], text: str, said: str
) -> None:
    graph.offer("publisher", "/lamp/state", "test_msgs/msg/Lamp")
    made = await expose(graph, MessageTypes(), configured(text), joints=["arm"], reserved=["battery"])
    assert made.components == [] and len(made.findings) == 1 and said in made.findings[0]


async def test_members_that_no_schema_says_are_named(
    graph: MemoryGraph, configured: Callable[[str], Configuration]
) -> None:
    text = '[[property]]\ntopic = "/plan"\ntype = "trajectory_msgs/msg/JointTrajectory"'
    made = await exposed(graph, configured(text))
    assert made.findings[0].startswith("/plan lacks points.positions: it is nested more than 4 deep; ")
    assert made.findings[0].endswith(", and 1 more") and len(made.components) == 1


async def test_a_graph_of_thousands_of_topics_is_exposed_within_bounds(graph: MemoryGraph) -> None:
    for number in range(1000):
        graph.offer("publisher", f"/n{number % 60}/t{number}", "sensor_msgs/msg/BatteryState")
    made = await exposed(graph, read_configuration(None, expose=["/*"]))
    assert 0 < len(made.components) <= 48
    assert sum(len(each.properties) for each in made.components) <= 192
    assert len(made.findings) == 1000 - sum(len(each.properties) for each in made.components)
    Client(made)


async def test_types_of_humble_have_no_hashes_and_work(
    folder: Path, configured: Callable[[str], Configuration]
) -> None:
    graph = MemoryGraph(MessageTypes([folder], "humble"))
    server = MemoryAction(graph, "/cell/count", FIBONACCI)
    client = Client(await exposed(graph, configured('[[action]]\naction = "/cell/count"')))
    await client.operate("cell", "count", {"order": 1})
    await client.until(lambda: server.goals)
    server.end(newest(server), sequence=[7])
    await client.until(lambda: client.state() == "succeeded")
    assert bytes(client.end().result) == b'{"sequence":[7]}'
