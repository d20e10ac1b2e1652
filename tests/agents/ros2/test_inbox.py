"""Messages of one topic: what is decoded, what is counted, and how much at most."""

import asyncio
import time

import pytest

from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.inbox import BURST_BYTES, LONGEST_BYTES, MOST_BYTES_S, Inbox, TypedInbox
from linked_fleet_agent.robots.ros2.state_layouts import JointStateReader
from memory_arm import ArmBench, MemoryArm
from memory_ros import TYPES, MemoryGraph
from ros2_robot import joint_state, text

pytestmark = pytest.mark.virtual
TOPIC, TEXT = "/words", "std_msgs/msg/String"


async def test_the_newest_message_is_decoded_and_older_ones_are_not() -> None:
    graph = MemoryGraph()
    inbox = Inbox(graph, TOPIC, TYPES.message(TEXT))
    assert inbox.newest() is None
    graph.publish(TOPIC, TEXT, b"\xff")
    graph.publish(TOPIC, TEXT, {"data": "two"})
    assert (inbox.newest(), inbox.bad_messages) == ({"data": "two"}, 0)
    graph.publish(TOPIC, TEXT, b"\xff")
    assert (inbox.newest(), inbox.bad_messages) == ({"data": "two"}, 1)


async def test_messages_that_cannot_be_read_are_counted_and_the_others_are_returned() -> None:
    graph = MemoryGraph()
    inbox = Inbox(graph, TOPIC, TYPES.message(TEXT))
    for said in ({"data": "one"}, b"", {"data": "x" * LONGEST_BYTES}, {"data": "two"}):
        graph.publish(TOPIC, TEXT, said)
    assert inbox.fetch() == [{"data": "one"}, {"data": "two"}]
    assert inbox.bad_messages == 2


async def test_a_flood_is_decoded_up_to_its_share(caplog: pytest.LogCaptureFixture) -> None:
    graph = MemoryGraph()
    inbox = Inbox(graph, TOPIC, TYPES.message(TEXT))
    said = {"data": "x" * (LONGEST_BYTES // 2)}
    size, began_s, taken = len(TYPES.message(TEXT).write(said)), time.monotonic(), 0
    for _ in range(100):
        for _ in range(32):
            graph.publish(TOPIC, TEXT, said)
        taken += len(inbox.fetch())
    most = BURST_BYTES + (time.monotonic() - began_s) * MOST_BYTES_S
    assert BURST_BYTES // size <= taken <= most / size
    assert inbox.bad_messages == 3200 - taken
    assert "bytes a second come on this topic" in caplog.text
    assert len(caplog.records) <= 12


async def test_bad_joint_states_are_counted_and_harmless() -> None:
    good = joint_state(["pan"], [0.01], stamp_ns=1)
    bad = (b"", good[:-1], b"\x00\x09" + good[2:], b"\xff" * 90, good + bytes(8), bytes(300_000))
    bad += (joint_state(["pan", "pan"], [1, 2]), joint_state(["pan"], [1, 2]), text("<robot/>"))
    arm = MemoryArm()
    async with ArmBench(arm) as bench:
        for payload in (*bad, joint_state(["pan", "stranger"], [0.01, 1.0])):
            arm.graph.publish("/joint_states", cdr.JOINT_STATE, payload)
        assert bench.robot.read(0.0).positions[0] == 0.01
        arm.positions["pan"] = 0.01
        await bench.run(1.5)
        assert bench.value("driver", "badMessages") == len(bad)


async def test_a_flood_of_joint_states_is_decoded_up_to_its_share_also_by_known_layouts() -> None:
    graph, most_bytes_s = MemoryGraph(), 1_000_000.0
    inbox = TypedInbox(graph, "/joint_states", JointStateReader(), longest=100_000, most_bytes_s=most_bytes_s)
    said = joint_state([f"j{n}" for n in range(1000)], [0.0] * 1000)
    for _ in range(32):
        graph.publish("/joint_states", cdr.JOINT_STATE, said)
    taken = list(inbox.arrivals())
    assert len(taken) == BURST_BYTES // len(said) < 32
    assert inbox.bad_messages == 32 - len(taken)
    await asyncio.sleep(len(said) / most_bytes_s)
    graph.publish("/joint_states", cdr.JOINT_STATE, said)
    assert [at_s for _, at_s in inbox.arrivals()] == [time.monotonic()]
