"""Commands while connections are lost, and reports about a URL or an unsafe server."""

import asyncio
import contextlib
import logging
from collections.abc import Iterator

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_runtime.redis import Connection, InvalidUrl
from redis_backends import Backend, opened
from store_samples import closing, served

_ROUNDS, _AT_ONCE = 50, 12


@pytest.fixture
def connection(server: Backend) -> Iterator[Connection]:
    yield from opened(server, closing(Connection(server.url, "news")))


async def test_writes_during_a_disconnection_raise(connection: Connection) -> None:
    """The client of a cluster closes all connections when one fails, including those about to be used by others."""

    async def ask(*command: str | int) -> bool:
        try:
            await connection.execute(*command)
        except RedisUnavailable:
            return False
        return True

    cut = 0
    for number in range(_ROUNDS):
        tasks = []
        for each in range(_AT_ONCE):
            tasks.append(asyncio.create_task(ask("SET", f"key {each}", number)))
            if each % 4 == 0:
                tasks.append(asyncio.create_task(ask("CLIENT", "KILL", "TYPE", "normal", "SKIPME", "no")))
            if number % 3:  # else all begin at once
                await asyncio.sleep(0)
        cut += (await asyncio.gather(*tasks)).count(False)
    assert cut
    await served(lambda: connection.execute("PING"))


async def test_many_commands_are_answered_in_their_order(connection: Connection) -> None:
    assert await connection.execute_all([("RPUSH", "a", "x")] * 600) == list(range(1, 601))


async def test_a_cancelled_command_leaves_no_answer_to_the_next(connection: Connection) -> None:
    await connection.execute("SET", "other", "right")
    for turns in range(_AT_ONCE):
        cancelled = asyncio.create_task(connection.execute("SET", "key", "wrong", "GET"))
        for _ in range(turns):
            await asyncio.sleep(0)
        cancelled.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await cancelled
        assert await connection.execute("GET", "other") == b"right"


async def test_a_refused_command_does_not_displace_the_answers_of_others(connection: Connection) -> None:
    with pytest.raises(RedisUnavailable, match="WRONGTYPE"):
        await connection.execute_all([("SET", "{a}1", "text"), ("HGETALL", "{a}1"), ("GET", "{a}1")])
    assert await connection.execute_all([("GET", "{a}1"), ("HSET", "{a}2", "name", "value"), ("HGETALL", "{a}2")]) == [
        b"text", 1, {b"name": b"value"},
    ]  # fmt: skip


async def test_following_begins_at_the_first_contact_without_gaps(connection: Connection, server: Backend) -> None:
    async with closing(Connection(server.url, "another")) as writer:
        await writer.execute("XADD", "news", "*", "n", "before")
        await connection.execute("PING")
        for number in range(150):
            await writer.execute("XADD", "news", "*", "n", number)
        found = [each[b"n"] for _ in range(2) for each in await connection.read_new_entries()]
        assert found == [str(number).encode() for number in range(150)]
        assert await connection.read_new_entries() == []


@pytest.mark.parametrize("server", ["memory", "valkey"], indirect=True)
async def test_a_server_that_may_lose_data_is_warned_of_once(
    server: Backend, connection: Connection, caplog: pytest.LogCaptureFixture
) -> None:
    async with closing(Connection(server.url, "another")) as operator:
        await operator.execute("CONFIG", "SET", "appendfsync", "everysec")
        try:
            with caplog.at_level(logging.WARNING):
                await asyncio.gather(*(connection.execute("PING") for _ in range(10)))
                await operator.execute("CLIENT", "KILL", "TYPE", "normal", "SKIPME", "yes")
                await served(lambda: connection.execute("PING"))
        finally:
            await operator.execute("CONFIG", "SET", "appendfsync", "always")
    assert [record.getMessage() for record in caplog.records] == [
        "Redis may lose what was accepted, its settings are appendfsync everysec"
    ]


@pytest.mark.parametrize(
    "url", ["http://localhost", "localhost:6379", "", "redis+cluster://", "redis+cluster://a:b@", "redis://a:port"]
)
def test_a_url_that_means_nothing_is_refused(url: str) -> None:
    with pytest.raises(InvalidUrl, match=r"REDIS_URL: .*\w"):
        Connection(url, "news")
