"""The server in memory uses the time of the loop, and its faults look to a client like those of a real server."""

import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_runtime.redis import Connection
from virtual.loop import VirtualLoop, virtual_time
from virtual.redis_server import RedisServer


@pytest.fixture
def loop() -> Iterator[VirtualLoop]:
    with virtual_time() as loop:
        yield loop


@pytest.fixture
def server(loop: VirtualLoop) -> RedisServer:
    return RedisServer(loop.internet)


@asynccontextmanager
async def connected(server: RedisServer) -> AsyncIterator[Connection]:
    connection = Connection(server.url, "news")
    try:
        await connection.execute("PING")
        yield connection
    finally:
        await connection.close()


def on(loop: VirtualLoop, server: RedisServer, scenario: Callable[[Connection], Awaitable[None]]) -> float:
    """Run a scenario with one connection; return its duration in seconds on the clock of the loop."""

    async def run() -> float:
        async with connected(server) as connection:
            before_s = time.monotonic()
            await scenario(connection)
            return time.monotonic() - before_s

    return loop.run(run())


def test_a_blocking_read_ends_with_the_first_entry_or_at_its_timeout(loop: VirtualLoop, server: RedisServer) -> None:
    async def nothing(connection: Connection) -> None:
        assert await connection.read_new_entries() == []

    async def something(connection: Connection) -> None:
        async with connected(server) as other:
            loop.call_later(
                0.25, lambda: writing.append(loop.create_task(other.execute("XADD", "news", "*", "a", "b")))
            )
            assert await connection.read_new_entries() == [{b"a": b"b"}]
            await writing[0]

    writing: list[Awaitable[object]] = []
    assert on(loop, server, nothing) == pytest.approx(1.0)
    assert on(loop, server, something) == pytest.approx(0.25)


def test_keys_expire_by_the_wall_clock_that_scripts_see(loop: VirtualLoop, server: RedisServer) -> None:
    async def scenario(connection: Connection) -> None:
        await connection.execute("SET", "short", "x", "PX", 500)
        await connection.execute("SET", "long", "x", "EX", 3600)
        await connection.execute("SET", "for good", "x")
        assert int((await connection.run_script("return redis.call('TIME')", ()))[0]) == int(time.time())
        loop.clock.step_wall(1.0)
        assert await connection.execute("MGET", "short", "long") == [None, b"x"]
        assert (server.keys("* *"), server.keys(lasting=True)) == (["for good"], ["for good"])
        assert server.keys() == ["for good", "long"]

    assert on(loop, server, scenario) < 0.001


def test_a_script_has_the_functions_and_errors_of_valkey(loop: VirtualLoop, server: RedisServer) -> None:
    async def scenario(connection: Connection) -> None:
        assert (
            await connection.run_script("return redis.sha1hex('')", ()) == b"da39a3ee5e6b4b0d3255bfef95601890afd80709"
        )
        assert await connection.run_script("return type(redis.pcall('INFO', 'replication'))", ()) == b"string"
        await connection.execute("SET", "text", "x")
        with pytest.raises(RedisUnavailable, match="WRONGTYPE"):
            await connection.run_script("return redis.call('HGETALL', KEYS[1])", ("text",))

    on(loop, server, scenario)


def test_a_server_that_is_down_refuses_and_has_its_data_when_it_is_back(loop: VirtualLoop, server: RedisServer) -> None:
    async def scenario(connection: Connection) -> None:
        await connection.execute("SET", "a", 1)
        server.unreachable()
        for _ in range(2):
            with pytest.raises(RedisUnavailable):
                await connection.execute("GET", "a")
        server.reachable()
        assert await connection.execute("GET", "a") == b"1"
        server.lose_everything()
        with pytest.raises(RedisUnavailable):
            await connection.execute("GET", "a")
        assert await connection.execute("GET", "a") is None

    assert on(loop, server, scenario) < 0.001


def test_a_server_that_hangs_times_out_and_runs_what_it_had_received(loop: VirtualLoop, server: RedisServer) -> None:
    async def scenario(connection: Connection) -> None:
        server.hang()
        with pytest.raises(RedisUnavailable, match="Timeout"):
            await connection.execute("SET", "a", 1)
        assert server.keys() == []
        server.release()
        assert server.keys() == ["a"]
        assert await connection.execute("GET", "a") == b"1"

    assert on(loop, server, scenario) == pytest.approx(2.0)


def test_an_answer_can_be_lost_although_the_command_ran(loop: VirtualLoop, server: RedisServer) -> None:
    async def scenario(connection: Connection) -> None:
        server.fail_after_executing(containing="mine")
        await connection.execute("INCR", "other")
        with pytest.raises(RedisUnavailable):
            await connection.execute("INCR", "mine")
        assert await connection.execute("MGET", "mine", "other") == [b"1", b"1"]

    on(loop, server, scenario)


def test_slow_commands_run_in_order(loop: VirtualLoop, server: RedisServer) -> None:
    async def scenario(connection: Connection) -> None:
        server.latency_s = 0.125
        assert await connection.execute_all([("RPUSH", "a", number) for number in range(3)]) == [1, 2, 3]
        assert await connection.execute("LRANGE", "a", 0, -1) == [b"0", b"1", b"2"]

    assert on(loop, server, scenario) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("replicas", "lagging", "confirmed", "within_s"), [(0, 0, False, 1), (1, 0, True, 0), (1, 1, False, 1)]
)
def test_a_replica_confirms_at_once_or_never(
    loop: VirtualLoop, server: RedisServer, replicas: int, lagging: int, confirmed: bool, within_s: float
) -> None:
    server.replicas, server.lagging = replicas, lagging

    async def scenario(connection: Connection) -> None:
        assert await connection.run_replicated_script("return redis.call('SET', KEYS[1], 1)", "a") == (b"OK", confirmed)

    assert on(loop, server, scenario) == pytest.approx(within_s, abs=0.001)


def test_an_error_answers_everything(loop: VirtualLoop, server: RedisServer) -> None:
    async def scenario(connection: Connection) -> None:
        server.error = "LOADING Valkey is loading the dataset in memory"
        with pytest.raises(RedisUnavailable, match="loading"):
            await connection.execute("GET", "a")
        server.error = ""
        assert await connection.execute("GET", "a") is None

    on(loop, server, scenario)


def test_its_wall_clock_is_stepped_by_itself(loop: VirtualLoop, server: RedisServer) -> None:
    async def scenario(connection: Connection) -> None:
        server.step_wall(3600)
        assert int((await connection.run_script("return redis.call('TIME')", ()))[0]) == pytest.approx(
            time.time() + 3600, abs=1
        )

    on(loop, server, scenario)
