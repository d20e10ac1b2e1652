"""The connection to Redis or Valkey, one server or a cluster; the only module that imports redis."""

import asyncio
import logging
import time
from collections.abc import AsyncGenerator, Awaitable, Callable, Sequence
from contextlib import nullcontext
from functools import lru_cache, partial
from typing import Any, TypeVar
from urllib.parse import unquote, urlsplit

import redis.asyncio
from redis import exceptions
from redis.asyncio.cluster import ClusterNode
from redis.asyncio.retry import Retry
from redis.backoff import NoBackoff

from linked_fleet_base.errors import DataDamaged, RedisUnavailable
from linked_fleet_runtime.redis_exchange import Command, Exchange

_log = logging.getLogger(__name__)

_ANSWER_S = 2.0  # for a command and for connecting; redis-py repeats a lost connection attempt after a second
_TOTAL_S = 3.0  # for one command in total, including its wait for a slot and the discovery of cluster nodes
_TURNS = 64  # concurrent commands; redis-py refuses more than its 100 connections
BATCH_SIZE = 256
"""Commands in one pipeline: about 25 ms of redis-py's time, in which nothing else runs."""
BACKGROUND_BATCH_SIZE = 32
"""Commands in one pipeline of periodic work that nobody waits for."""
# concurrent waits for replicas, counted separately: a replica that hangs must not block the renewal of leases
_WAITS = 16
_REPLICA_MS = 1_000  # wait for a replica's confirmation; less than the timeout of a command
_BLOCK_MS = 1_000  # blocking time of a stream read; less than the timeout of a command
BACKOFF_S = 0.2
"""Pause between two attempts to read or write the stream during an outage."""
GATHER_S = 0.02
"""Time in which messages are collected if nobody waits, because each command costs a third of a millisecond."""
_UNREACHABLE = (
    exceptions.ConnectionError, exceptions.TimeoutError, exceptions.ClusterError, exceptions.RedisClusterException,
    exceptions.ReadOnlyError, exceptions.OutOfMemoryError, exceptions.TryAgainError, exceptions.AskError,
    OSError, TimeoutError,
)  # fmt: skip
# A key holds a foreign value, because data are damaged or shared.
_DAMAGED = "WRONGTYPE"
# Errors without a class of their own. The last two come from a server that is no longer master.
_NOT_NOW = ("MISCONF", "NOREPLICAS", "BUSY ", "LOADING", "CLUSTERDOWN", "MASTERDOWN", _DAMAGED, "UNBLOCKED",
            "WAIT cannot")  # fmt: skip
# Messages of errors when writing to a connection that was just lost: from uvloop, and from redis-py, whose cluster
# client closes all connections when one fails, including those in use.
_CLOSED = ("the handler is closed", "'NoneType' object has no attribute 'writelines'")
_T = TypeVar("_T")
_DURABLE = {"appendonly": "yes", "appendfsync": "always"}


class InvalidUrl(ValueError):  # noqa: N818 -- a state of the configuration, not a defect
    """The URL of the server is invalid. One line for people."""


class Connection:
    """Sends commands singly or in pipelines, in bounded time; connects on demand, also after an outage.

    Nothing is sent twice; callers decide what may be repeated. ``stream`` is followed from its position at the first
    contact. Raises InvalidUrl for an invalid URL.
    """

    def __init__(self, url: str, stream: str) -> None:
        try:
            self._client = _client(url)  # Any: redis-py leaves raw commands untyped
        except ValueError as error:
            raise InvalidUrl(f"REDIS_URL: {error}") from error
        self._server = _exchange(self._client)
        self._stream = stream
        self._position: str | None = None
        self._rested_s = 0.0
        self._turns = asyncio.Semaphore(_TURNS)
        self._waits = asyncio.Semaphore(_WAITS)
        self._open = False
        self._opening = asyncio.Lock()
        self._failed_s = float("-inf")
        self.outage_count = 0

    @property
    def since_outage_s(self) -> float:
        """Seconds since the last outage; infinite without one."""
        return time.monotonic() - self._failed_s

    async def close(self) -> None:
        if self._server is not None:
            await self._server.close()
        await self._client.aclose()
        await _disconnect(self._client)

    async def _failed(self, error: Exception) -> RedisUnavailable:
        self._failed_s = time.monotonic()
        self.outage_count += 1
        self._open = False
        await _disconnect(self._client)
        kind = DataDamaged if str(error).startswith(_DAMAGED) else RedisUnavailable
        return kind(f"{type(error).__name__}: {error}")

    async def execute(self, *command: str | bytes | int) -> Any:
        """Send one command and return its answer. Raises RedisUnavailable."""
        return await self._within_bounds(partial(self._execute, *command), self._turns)

    async def execute_all(self, commands: Sequence[Command], batch_size: int = BATCH_SIZE) -> list[Any]:
        """Send commands for any slots in pipelines and return their answers. Raises RedisUnavailable.

        Only commands for the same slot keep their order. Long lists are sent in parts, between which others are served.
        """
        answers: list[Any] = []
        for first in range(0, len(commands), batch_size):
            part = commands[first : first + batch_size]
            answers += await self._within_bounds(partial(self._send, part), self._turns)
        return answers

    async def run_script(self, script: str, keys: tuple[str, ...], *arguments: str | bytes | int) -> Any:
        """Run a script, whose keys share one slot, and return its answer. Raises RedisUnavailable."""
        return await self.execute(*eval_command(script, keys, *arguments))

    async def keys_on_other_masters(self, key: str, others: Sequence[str]) -> list[str]:
        """Return one of ``others`` for each master that has any of them and not ``key``. Raises RedisUnavailable."""
        if self._server is not None:
            return []
        return await self._within_bounds(partial(self._on_other_masters, key, others))

    async def run_replicated_script(self, script: str, key: str, *arguments: str) -> tuple[Any, bool]:
        """Run a script that writes to ``key``. Return its answer, and True if a replica has this and all earlier
        writes.

        Script and WAIT use one connection to the master of the key, because WAIT covers writes of its own connection
        only. Redirections to a new master are not followed. Raises RedisUnavailable.
        """
        commands: list[Command] = [("EVAL", script, 1, key, *arguments), ("WAIT", 1, _REPLICA_MS)]
        answer, replicas = await self._within_bounds(partial(self._send, commands, key), self._waits)
        return answer, replicas > 0

    async def read_new_entries(self) -> list[dict[bytes, bytes]]:
        """Return the entries of the stream since the last call, waiting up to a second. Raises RedisUnavailable.

        After news, the next call first collects further entries for ``GATHER_S``.
        """
        raise_pending_cancellation()
        await asyncio.sleep(self._rested_s - time.monotonic())
        answer = await self._within_bounds(self._read_stream)  # takes no slot, because it waits most of the time
        entries = answer[0][1] if answer else []
        if entries:
            self._position = entries[-1][0].decode()
            self._rested_s = time.monotonic() + GATHER_S
        return [fields for _, fields in entries]

    async def stream_entries(self) -> AsyncGenerator[dict[bytes, bytes] | None, None]:
        """Yield each entry of the stream from the first contact on. Outages are waited out.

        None is yielded after outages that any method met, including those before the first call.
        """
        seen = 0
        while True:
            try:
                told = await self.read_new_entries()
            except RedisUnavailable:  # not logged, because the lease renewal reports the same outage
                await asyncio.sleep(BACKOFF_S)
                continue
            lost, seen = self.outage_count > seen, self.outage_count
            if lost:
                yield None
            for fields in told:
                yield fields

    async def _read_stream(self) -> Any:
        assert self._position is not None  # since the first contact
        return await self._execute("XREAD", "COUNT", 100, "BLOCK", _BLOCK_MS, "STREAMS", self._stream, self._position)

    async def _execute(self, *command: str | bytes | int) -> Any:
        if self._server is None:
            return await self._client.execute_command(*command)
        (answer,) = _checked(await self._server.send([command]))
        return answer

    async def _send(self, commands: Sequence[Command], key: str = "") -> list[Any]:
        """Send commands and return their answers; in a cluster to the master of ``key``, if it is given."""
        if self._server is not None:
            return _checked(await self._server.send(commands))
        return _checked(await (self._at_master(key, commands) if key else self._scattered(commands)))

    async def _scattered(self, commands: Sequence[Command]) -> list[Any]:
        """Send commands to the nodes of a cluster. Return their answers, with errors among them."""
        pipeline = self._client.pipeline(transaction=False)
        for command in commands:
            pipeline.execute_command(*command)
        answers: list[Any] = await pipeline.execute(raise_on_error=False)
        return answers

    async def _on_other_masters(self, key: str, others: Sequence[str]) -> list[str]:
        await self._client.initialize()
        masters = {str(self._client.get_node_from_key(other)): other for other in (*others, key)}
        return [other for other in masters.values() if other != key]

    async def _at_master(self, key: str, commands: Sequence[Command]) -> list[Any]:
        """Send commands to the master of a key in a cluster. Return their answers, with errors among them."""
        await self._client.initialize()
        pipeline = self._client.pipeline(transaction=False)
        for command in commands:
            pipeline.execute_command(*command, target_nodes=self._client.get_node_from_key(key))
        answers: list[Any] = await pipeline.execute(raise_on_error=False, allow_redirections=False)
        return answers

    async def _within_bounds(self, step: Callable[[], Awaitable[_T]], slots: asyncio.Semaphore | None = None) -> _T:
        """Take one of ``slots`` and await ``step``, in bounded time. Raises RedisUnavailable.

        The first contact records the position of the stream. redis-py's own bound of an answer makes a task for each
        command, half of a command's cost. A cluster keeps it, because its client looks for a new master only after a
        timeout of its own.
        """
        waits = not self._open or (slots is not None and slots.locked())
        try:
            async with asyncio.timeout(_TOTAL_S if waits or self._server is None else _ANSWER_S) as bound:
                if not self._open:
                    await self._open_once()
                async with slots or nullcontext():
                    if waits and self._server is not None:
                        until_s = asyncio.get_running_loop().time() + _ANSWER_S
                        bound.reschedule(until_s if (total_s := bound.when()) is None else min(total_s, until_s))
                    return await step()
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

    async def _open_once(self) -> None:
        async with self._opening:  # redis-py cannot handle many concurrent commands before it knows the nodes
            if not self._open:
                await self._greet()
                self._open = True

    async def _greet(self) -> None:
        last = await self._execute("XREVRANGE", self._stream, "+", "-", "COUNT", 1)
        if self._position is not None:  # not the first contact
            return
        self._position = last[0][0].decode() if last else "0-0"
        try:
            found = await self._client.config_get("append*")
        except exceptions.ResponseError:  # many hosted servers forbid CONFIG
            return
        finally:
            if self._server is not None:  # the only command on a connection of the pool
                await self._client.connection_pool.disconnect()
        wrong = [f"{name} {found[name]}" for name, value in _DURABLE.items() if found.get(name, value) != value]
        if wrong:
            _log.warning("Redis may lose what was accepted, its settings are %s", " and ".join(wrong))


def eval_command(script: str, keys: tuple[str, ...], *arguments: str | bytes | int) -> Command:
    """Return the command that runs a script."""
    return "EVAL", _encoded(script), len(keys), *keys, *arguments


@lru_cache(maxsize=256)
def _encoded(script: str) -> bytes:
    """Encode a script once; the Redis client would do so at each call."""
    return script.encode()


def _checked(answers: list[Any]) -> list[Any]:
    """Raise the first error unchanged; redis-py would prefix its text, so that it could not be recognized."""
    for answer in answers:
        if isinstance(answer, Exception):
            raise answer
    return answers


def _client(url: str) -> Any:
    scheme, _, rest = url.partition("://")
    once = Retry(NoBackoff(), 0)
    # RESP 2, so that answers have one form with every server.
    options: dict[str, Any] = {"socket_connect_timeout": _ANSWER_S, "protocol": 2}
    if scheme in ("redis", "rediss", "unix"):
        return redis.asyncio.Redis.from_url(url, retry=once, socket_timeout=None, **options)
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
        socket_timeout=_ANSWER_S,
        **options,
    )


def _exchange(client: Any) -> Exchange | None:
    """Return the exchange with a single server, in the forms of answers that redis-py gives; None for a cluster."""
    if isinstance(client, redis.asyncio.RedisCluster):
        return None
    return Exchange(client.connection_pool.make_connection, client.response_callbacks, exceptions.ResponseError)


async def _disconnect(client: Any) -> None:
    """Reconnect all nodes of a cluster.

    redis-py detects a dead connection before use with a single server but not with a cluster, and closes a cluster's
    connections only if the last command succeeded.
    """
    if isinstance(client, redis.asyncio.RedisCluster):
        manager = client.nodes_manager
        for node in (
            *manager.startup_nodes.values(),
            *manager.nodes_cache.values(),
        ):  # they may differ and yet be equal
            await node.disconnect_free_connections()


def raise_pending_cancellation() -> None:
    """Raise a pending cancellation.

    redis-py sends with ``asyncio.wait_for``, which before Python 3.12 loses a cancellation that arrives when sending
    completes. Without this, ending the reader of the stream could wait for ever.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
