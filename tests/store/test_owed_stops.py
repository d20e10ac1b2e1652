"""Owed stops in Redis: one gateway reads what another one wrote, and is told of each change."""

import time
from collections.abc import Iterator

import pytest

from linked_fleet_agent.wire.messages import WIRE_VERSION, Stop
from linked_fleet_gateway.actions.redis_scripts import Keys
from linked_fleet_gateway.actions.store import RETENTION_S, ActionStore
from linked_fleet_state.owed_stops import OwedStop
from redis_backends import Backend, opened

HOSTILE = ["arm 2/left", "@fleet", "}{", "..", "später", "x\r\nFLUSHALL\r\n", "\0", "*", "a" * 128]


@pytest.fixture
def a(server: Backend) -> Iterator[ActionStore]:
    yield from opened(server, ActionStore(server.url, "fleet", "a"))


@pytest.fixture
def b(server: Backend) -> Iterator[ActionStore]:
    yield from opened(server, ActionStore(server.url, "fleet", "b"))


def _owed(robot: str, id: str, asked_ns: int | None = None) -> OwedStop:
    stop = Stop(version=WIRE_VERSION, id=id, joints=("elbow",), reason="stopped")
    return OwedStop(robot, stop, time.time_ns() if asked_ns is None else asked_ns)


@pytest.mark.parametrize("robot", HOSTILE)
def test_another_gateway_reads_an_owed_stop_until_it_is_removed(
    server: Backend, a: ActionStore, b: ActionStore, robot: str
) -> None:
    owed = _owed(robot, "s1")
    server.run(a.owed_stops.write([owed]))
    assert server.run(b.owed_stops.read(owed.key)) == owed
    assert server.run(b.owed_stops.read_all()) == [owed]
    server.run(b.owed_stops.remove([owed.key]))
    assert server.run(a.owed_stops.read(owed.key)) is None
    assert server.run(a.owed_stops.read_all()) == []


def test_the_earliest_stop_is_read_first_and_an_expired_one_never(
    server: Backend, a: ActionStore, b: ActionStore
) -> None:
    now_ns = time.time_ns()
    late, early = _owed("r", "s1", now_ns), _owed("r", "s2", now_ns - 10**9)
    expired = _owed("r", "s3", now_ns - int((RETENTION_S + 60) * 1e9))
    server.run(a.owed_stops.write([late, early, expired]))
    assert server.run(b.owed_stops.read_all()) == [early, late]
    assert server.run(b.owed_stops.read(expired.key)) is None


@pytest.mark.parametrize("body", [b"", b"{", b'{"robot":"r"}', b"\xff" * 10, b"1" * 600_000])
def test_an_entry_that_cannot_be_read_is_left_out_and_removed(server: Backend, a: ActionStore, body: bytes) -> None:
    good, key = _owed("r", "s1"), Keys("fleet").owed_stops
    server.run(a.owed_stops.write([good]))
    server.run(a._redis.execute("HSET", key, "r bad", body))
    assert server.run(a.owed_stops.read_all()) == [good]
    assert server.run(a._redis.execute("HKEYS", key)) == [b"r s1"]
