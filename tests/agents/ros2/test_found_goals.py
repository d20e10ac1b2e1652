"""Goals of actions across restarts of servers, and of what is between them and the agent."""

import asyncio
from pathlib import Path

import pytest

from linked_fleet_agent.robots.ros2.goals import ActionClient, GoalError
from linked_fleet_agent.robots.ros2.types import MessageTypes
from memory_ros import MemoryAction, MemoryGraph

pytestmark = pytest.mark.virtual

FIBONACCI, GOAL = "test_msgs/action/Fibonacci", bytes(range(16))


@pytest.fixture
def graph(tmp_path: Path) -> MemoryGraph:
    file = tmp_path / "test_msgs" / "action" / "Fibonacci.action"
    file.parent.mkdir(parents=True)
    file.write_text("int32 order\n---\nint32[] sequence\n---\nint32[] sequence")
    return MemoryGraph(MessageTypes([tmp_path]), patience_s=5.0)


def client(graph: MemoryGraph) -> ActionClient:
    return ActionClient(graph, graph.types, "/count", FIBONACCI)


async def test_a_result_is_kept_by_the_server_for_who_asks_later(graph: MemoryGraph) -> None:
    server = MemoryAction(graph, "/count", FIBONACCI)
    await client(graph).send(GOAL, {"order": 3})
    server.end(GOAL, sequence=[1, 1, 2])
    assert (await client(graph).result(GOAL)).result == {"sequence": [1, 1, 2]}


async def test_a_goal_that_the_server_has_forgotten_is_lost_at_once(graph: MemoryGraph) -> None:
    server = MemoryAction(graph, "/count", FIBONACCI)
    first = client(graph)
    await first.send(GOAL, {"order": 3})
    server.forget()
    begun_s = asyncio.get_running_loop().time()
    with pytest.raises(GoalError, match="what became of the goal is not known: /count does not know the goal any more"):
        await first.result(GOAL)
    assert asyncio.get_running_loop().time() - begun_s < 1.0


async def test_calls_that_the_transport_ends_do_not_end_the_wait_while_the_server_works(graph: MemoryGraph) -> None:
    server = MemoryAction(graph, "/count", FIBONACCI)
    asking = client(graph)
    await asking.send(GOAL, {"order": 3})
    waiting = asyncio.ensure_future(asking.result(GOAL))
    await asyncio.sleep(50.0)  # the transport of the graph ends each call after five seconds
    assert not waiting.done()
    server.end(GOAL, sequence=[8])
    assert (await waiting).result == {"sequence": [8]}


async def test_a_server_that_has_left_makes_the_result_unknown(graph: MemoryGraph) -> None:
    server = MemoryAction(graph, "/count", FIBONACCI)
    asking = client(graph)
    await asking.send(GOAL, {"order": 3})
    waiting = asyncio.ensure_future(asking.result(GOAL))
    await asyncio.sleep(1.0)
    graph.leave(*server.names)
    with pytest.raises(GoalError, match="what became of the goal is not known: "):
        await waiting


async def test_all_goals_are_cancelled_also_those_of_others(graph: MemoryGraph) -> None:
    server = MemoryAction(graph, "/count", FIBONACCI)
    await client(graph).send(GOAL, {"order": 3})
    await client(graph).send(bytes(16)[:15] + b"\1", {"order": 4})
    assert set(await client(graph).cancel_all()) == set(server.goals)
    asked = [said for name, said in graph.calls if name.endswith("cancel_goal")]
    assert asked == [{"goal_info": {"goal_id": {"uuid": bytes(16)}, "stamp": {"sec": 0, "nanosec": 0}}}]
