"""Messages of one topic: what is decoded, what is counted, and how much at most."""

import time

import pytest

from linked_fleet_agent.robots.ros2.inbox import BURST_BYTES, LONGEST_BYTES, MOST_BYTES_S, Inbox
from memory_ros import TYPES, MemoryGraph

pytestmark = pytest.mark.virtual
TOPIC, TEXT = "/words", "std_msgs/msg/String"


async def test_the_newest_message_is_decoded_and_older_ones_are_not() -> None:
    graph = MemoryGraph()
    inbox = Inbox(graph, TOPIC, TYPES.message(TEXT))
    assert inbox.newest() == {}
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
