"""The connection to Redis or Valkey, one server or a cluster; the only module that imports redis."""

import asyncio
import logging
import time
from collections.abc import AsyncGenerator, AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any
from urllib.parse import unquote, urlsplit

import redis.asyncio
from redis import exceptions
from redis.asyncio.cluster import ClusterNode
from redis.asyncio.retry import Retry
from redis.backoff import NoBackoff

_log = logging.getLogger(__name__)

_ANSWER_S = 2.0  # for a command, and to connect: what opens a connection is sent again after a second, if it was lost
_PATIENCE_S = 3.0  # for one command in all, waiting for its turn and finding the nodes of a cluster included
_TURNS = 64  # commands at once; redis-py refuses more than its 100 connections
AT_ONCE = 256
"""Commands in one go: some 25 ms of redis-py's time, in which nobody else is served."""
UNHURRIED = 32
"""Commands in one go of what is done again and again, and nobody waits for."""
_WAITS = 16  # for replicas at once, beside the turns: a replica that hangs must not keep the leases from being renewed
_REPLICA_MS = 1_000  # for a replica to confirm; below the timeout of a command
_BLOCK_MS = 1_000  # of a read of the news; below the timeout of a command
BACKOFF_S = 0.2
"""Between two tries to read, or to tell, the news during an outage."""
GATHER_S = 0.02
"""In which what comes next is gathered where nobody waits for it: each command costs a third of a millisecond here,
however little it says."""
_UNREACHABLE = (
    exceptions.ConnectionError, exceptions.TimeoutError, exceptions.ClusterError, exceptions.RedisClusterException,
    exceptions.ReadOnlyError, exceptions.OutOfMemoryError, exceptions.TryAgainError, exceptions.AskError,
    OSError, TimeoutError,
)  # fmt: skip
# Errors without a class. WRONGTYPE: our keys hold what we did not write, because the data are damaged or somebody else
# uses them. The last two are those of a server that is no longer master.
_NOT_NOW = ("MISCONF", "NOREPLICAS", "BUSY ", "LOADING", "CLUSTERDOWN", "MASTERDOWN", "WRONGTYPE", "UNBLOCKED",
            "WAIT cannot")  # fmt: skip
# Words for writing to a connection that has just been lost: uvloop's, and those of redis-py, whose client of a cluster
# closes all connections when one of them fails, also those that others are about to write to.
_CLOSED = ("the handler is closed", "'NoneType' object has no attribute 'writelines'")
_DURABLE = {"appendonly": "yes", "appendfsync": "always"}


class StoreUnavailable(Exception):  # noqa: N818 -- a state of the world, not a defect
    """Redis does not serve: unreachable, loading, read-only, with damaged data, or without memory or a replica that
    should answer.

    Whether the command ran is unknown.
    """


class BadUrl(ValueError):  # noqa: N818 -- it reads as what it is, like the one above
    """The URL of the server means nothing. One line for a human."""


class Connection:
    """Commands one by one or many at once, each in bounded time; connects when it must, and again after an outage.

    Nothing is sent twice: what to repeat is for those to say who know what may be repeated. ``stream`` is followed
    from where it was at the first contact. BadUrl for a URL that means nothing.
    """

    def __init__(self, url: str, stream: str) -> None:
        try:
            self._client = _client(url)  # Any: redis-py leaves raw commands untyped
        except ValueError as error:
            raise BadUrl(f"REDIS_URL: {error}") from error
        self._stream = stream
        self._position: str | None = None
        self._rested_s = 0.0
        self._turns = asyncio.Semaphore(_TURNS)
        self._waits = asyncio.Semaphore(_WAITS)
        self._open = False
        self._opening = asyncio.Lock()
        self._failed_s = float("-inf")
        self.outages = 0

    @property
    def served_s(self) -> float:
        """Time since the last outage; endless without any."""
        return time.monotonic() - self._failed_s

    async def close(self) -> None:
        await self._client.aclose()
        await _disconnect(self._client)

    async def _failed(self, error: Exception) -> StoreUnavailable:
        self._failed_s = time.monotonic()
        self.outages += 1
        self._open = False
        await _disconnect(self._client)
        return StoreUnavailable(f"{type(error).__name__}: {error}")

    async def one(self, *command: str | bytes | int) -> Any:
        """The answer to one command; StoreUnavailable."""
        async with self._contact(), self._turns:
            return await self._client.execute_command(*command)

    async def all(self, commands: Sequence[tuple[str | bytes | int, ...]], at_once: int = AT_ONCE) -> list[Any]:
        """The answers to commands of any slots, many sent at once; in order only those to one slot. StoreUnavailable.

        Thousands are sent in parts, between which others have their turn.
        """
        answers: list[Any] = []
        for first in range(0, len(commands), at_once):
            async with self._contact(), self._turns:
                pipeline = self._client.pipeline(transaction=False)
                for command in commands[first : first + at_once]:
                    pipeline.execute_command(*command)
                answers += _checked(await pipeline.execute(raise_on_error=False))
        return answers

    async def run(self, script: str, keys: tuple[str, ...], *arguments: str | bytes | int) -> Any:
        """The answer of a script, whose keys are of one slot; StoreUnavailable."""
        return await self.one("EVAL", script, len(keys), *keys, *arguments)

    async def elsewhere(self, key: str, others: Sequence[str]) -> list[str]:
        """One of ``others`` for each master that has any of them and is not that of ``key``; StoreUnavailable."""
        if not isinstance(self._client, redis.asyncio.RedisCluster):
            return []
        async with self._contact():
            await self._client.initialize()
            masters = {str(self._client.get_node_from_key(other)): other for other in (*others, key)}
            return [other for other in masters.values() if other != key]

    async def replicated(self, script: str, key: str, *arguments: str) -> tuple[Any, bool]:
        """The answer of a script that writes to ``key``, and whether a replica has that and all written before.

        Both are asked in one go over one connection, to the server that is master of the key: WAIT knows the writes of
        its own connection only. A server that is no longer master is not followed to the new one. StoreUnavailable.
        """
        async with self._contact(), self._waits:
            target, once = {}, {}
            if isinstance(self._client, redis.asyncio.RedisCluster):
                await self._client.initialize()
                target, once = {"target_nodes": self._client.get_node_from_key(key)}, {"allow_redirections": False}
            pipeline = self._client.pipeline(transaction=False)
            pipeline.execute_command("EVAL", script, 1, key, *arguments, **target)
            pipeline.execute_command("WAIT", 1, _REPLICA_MS, **target)
            answer, replicas = _checked(await pipeline.execute(raise_on_error=False, **once))
            return answer, replicas > 0

    async def follow(self) -> list[dict[bytes, bytes]]:
        """Return the entries of the stream since the last call, if any comes within a second; StoreUnavailable.

        The first news are told at once, those that come hard upon them together.
        """
        heed_cancellation()
        await asyncio.sleep(self._rested_s - time.monotonic())
        async with self._contact():  # takes no turn: it waits most of the time
            command = ("XREAD", "COUNT", 100, "BLOCK", _BLOCK_MS, "STREAMS", self._stream, self._position)
            answer = await self._client.execute_command(*command)
        entries = answer[0][1] if answer else []
        if entries:
            self._position = entries[-1][0].decode()
            self._rested_s = time.monotonic() + GATHER_S
        return [fields for _, fields in entries]

    async def news(self) -> AsyncGenerator[dict[bytes, bytes] | None, None]:
        """Yield each entry that comes to the stream from the first contact on. Outages are waited out.

        None follows the outages that any method met, those before the first call included.
        """
        seen = 0
        while True:
            try:
                told = await self.follow()
            except StoreUnavailable:  # not worth a line: whoever renews a lease meets the same outage
                await asyncio.sleep(BACKOFF_S)
                continue
            lost, seen = self.outages > seen, self.outages
            if lost:
                yield None
            for fields in told:
                yield fields

    @asynccontextmanager
    async def _contact(self) -> AsyncIterator[None]:
        """Bounds the time and gives errors one name; the first contact notes where the stream is."""
        try:
            async with asyncio.timeout(_PATIENCE_S):
                async with self._opening:  # many commands at once are too much for redis-py before it knows the nodes
                    if not self._open:
                        await self._greet()
                        self._open = True
                yield
        except _UNREACHABLE as error:
            raise await self._failed(error) from error
        except exceptions.ResponseError as error:
            if not str(error).startswith(_NOT_NOW):
                raise
            raise await self._failed(error) from error
        except (RuntimeError, AttributeError) as error:
            if not str(error).endswith(_CLOSED):
                raise
            raise await self._failed(error) from error

    async def _greet(self) -> None:
        last = await self._client.execute_command("XREVRANGE", self._stream, "+", "-", "COUNT", 1)
        if self._position is not None:  # not the first contact
            return
        self._position = last[0][0].decode() if last else "0-0"
        try:
            found = await self._client.config_get("append*")
        except exceptions.ResponseError:  # many hosted servers forbid the question
            return
        wrong = [f"{name} {found[name]}" for name, value in _DURABLE.items() if found.get(name, value) != value]
        if wrong:
            _log.warning("Redis may lose what was accepted, its settings are %s", " and ".join(wrong))


def _checked(answers: list[Any]) -> list[Any]:
    """Raises the first error as the server said it; redis-py would put words before it by which it is not known."""
    for answer in answers:
        if isinstance(answer, Exception):
            raise answer
    return answers


def _client(url: str) -> Any:
    scheme, _, rest = url.partition("://")
    once = Retry(NoBackoff(), 0)
    # RESP 2, so that answers look the same with every server.
    options: dict[str, Any] = {"socket_connect_timeout": _ANSWER_S, "socket_timeout": _ANSWER_S, "protocol": 2}
    if scheme in ("redis", "rediss", "unix"):
        return redis.asyncio.Redis.from_url(url, retry=once, **options)
    if scheme not in ("redis+cluster", "rediss+cluster"):
        raise ValueError(f"{scheme!r} is no scheme of Redis: redis, rediss, unix, redis+cluster or rediss+cluster")
    user, _, hosts = rest.rstrip("/").rpartition("@")
    nodes = [urlsplit(f"//{host.strip()}") for host in hosts.split(",")]
    if not all(node.hostname for node in nodes):
        raise ValueError("a cluster is written as redis+cluster://host:port,host:port")
    name, _, password = user.partition(":")
    return redis.asyncio.RedisCluster(
        startup_nodes=[ClusterNode(node.hostname or "", node.port or 6379) for node in nodes],
        username=unquote(name) or None,
        password=unquote(password) or None,
        ssl=scheme == "rediss+cluster",
        retry=once,
        **options,
    )


async def _disconnect(client: Any) -> None:
    """Have all nodes of a cluster connected anew.

    redis-py tells a dead connection before it uses it with one server, but not with a cluster, and closes a cluster's
    connections only when the last command succeeded.
    """
    if isinstance(client, redis.asyncio.RedisCluster):
        manager = client.nodes_manager
        for node in (
            *manager.startup_nodes.values(),
            *manager.nodes_cache.values(),
        ):  # they may differ and yet be equal
            await node.disconnect_free_connections()


def heed_cancellation() -> None:
    """redis-py sends with ``asyncio.wait_for``, which before Python 3.12 loses a cancellation that comes as the sending
    is done; without this whoever waits for the reader of the news to end would wait for ever."""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
