"""The agent's Zenoh session. Apart from the ROS 2 driver, no other module of the agent imports zenoh.

Zenoh calls back on its own threads; these callbacks only schedule work on the event loop.
"""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractContextManager, asynccontextmanager, contextmanager
from typing import Any

import zenoh

from linked_fleet_agent.transport import Publisher, Query, TransportError
from linked_fleet_agent.wire import parts, traceparent
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.transport import TRANSPORT
from linked_fleet_agent.wire.trust import Credentials, agent_access_control

_log = logging.getLogger(__name__)

_OPEN_TIMEOUT_MS = 1_000
_RETRY_S = 0.3


def configuration(
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    lease_ms: int,
    credentials: Credentials | None = None,
    keys: Keys | None = None,
) -> zenoh.Config:
    """Return the configuration of a client of ``connect``, or of a peer if ``listen`` is given. No multicast scouting.

    A peer with ``credentials`` accepts messages under ``keys`` only from certified gateways and routers.
    """
    config = zenoh.Config()
    values: dict[str, object] = {
        **TRANSPORT,
        # Clients see each other through one router or peer, so that a second agent of the same name is noticed.
        "mode": "peer" if listen else "client",
        "connect/endpoints": list(connect),
        "connect/timeout_ms": _OPEN_TIMEOUT_MS,
        "connect/exit_on_failure": not listen,
        # A gateway that was away for long must find its robots within two seconds too; Zenoh's default is 4 s.
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 1.5},
        "listen/endpoints": list(listen),
        "transport/link/tx/lease": lease_ms,
    }
    if credentials is not None:
        values |= credentials.configuration()
        if listen:
            values["access_control"] = agent_access_control(keys or Keys())
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


@asynccontextmanager
async def open_session(
    connect: tuple[str, ...],
    listen: tuple[str, ...] = (),
    lease_ms: int = 2_000,
    credentials: Credentials | None = None,
    keys: Keys | None = None,
) -> AsyncIterator["ZenohSession"]:
    """Open a session that several links may share. Wait without limit until an endpoint answers.

    Zenoh reconnects later and renews all declarations by itself. Raises zenoh.ZError for an invalid endpoint.
    """
    config = configuration(connect, listen, lease_ms, credentials, keys)
    session, waiting = None, False
    while session is None:
        try:
            # A fresh thread per attempt: opening blocks for at most _OPEN_TIMEOUT_MS and cannot be cancelled.
            session = await asyncio.to_thread(zenoh.open, config)
        except zenoh.ZError as error:
            if not waiting:
                # An agent may start before its gateway. Zenoh's message ends in a path of its own sources.
                reason = str(error).partition(" at /")[0]
                _log.info("no answer from %s yet (%s); retrying", ", ".join(connect) or "no endpoint", reason)
            waiting = True
            await asyncio.sleep(_RETRY_S)
    _log.info("connected to %s", ", ".join(connect) or "peers")
    try:
        yield ZenohSession(session)
    finally:
        await asyncio.to_thread(session.close)


class ZenohSession:
    """Implements ``linked_fleet_agent.transport.Session``. Create and use it on the event loop."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session, self._loop = session, asyncio.get_running_loop()

    @contextmanager
    def declare_publisher(self, key: str, *, reliable: bool, express: bool) -> Iterator[Publisher]:
        control = zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP
        with self._session.declare_publisher(
            key, congestion_control=control, priority=zenoh.Priority.DATA, express=express
        ) as publisher:
            yield _Publisher(publisher)

    def declare_queryable(self, key: str, answer: Callable[[Query], None]) -> AbstractContextManager[object]:
        take = self._in_loop(lambda query: answer(_Query(query)))
        return self._session.declare_queryable(key, take, complete=True)

    def subscribe(self, key: str, hear: Callable[[str], None]) -> AbstractContextManager[object]:
        return self._session.declare_subscriber(key, self._in_loop(lambda sample: hear(str(sample.key_expr))))

    def subscribe_payloads(self, key: str, limit: int, hear: Callable[[bytes], None]) -> AbstractContextManager[object]:
        def take(sample: zenoh.Sample) -> None:
            if len(sample.payload) <= limit:
                hear(sample.payload.to_bytes())

        return self._session.declare_subscriber(key, self._in_loop(take))

    @contextmanager
    def latest_payload(self, key: str, limit: int) -> Iterator[Callable[[], bytes | None]]:
        """Yield a function that returns the newest payload since its last call, None without one or if it is too long.

        Messages in between cost no Python code.
        """
        with self._session.declare_subscriber(key, zenoh.handlers.RingChannel(1)) as subscriber:

            def take() -> bytes | None:
                sample = subscriber.try_recv()
                return None if sample is None or len(sample.payload) > limit else sample.payload.to_bytes()

            yield take

    def subscribe_tokens(self, key: str, hear: Callable[[str, bool], None]) -> AbstractContextManager[object]:
        def take(sample: zenoh.Sample) -> None:
            hear(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        return self._session.liveliness().declare_subscriber(key, self._in_loop(take), history=True)

    def declare_token(self, key: str) -> AbstractContextManager[object]:
        return self._session.liveliness().declare_token(key)

    async def list_tokens(self, key: str, timeout_s: float) -> set[str]:
        def look() -> set[str]:
            replies = self._session.liveliness().get(key, timeout=timeout_s)
            return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

        return await asyncio.to_thread(look)

    def _in_loop(self, handler: Callable[[Any], None]) -> Any:
        """Return a handler of Zenoh that schedules ``handler`` from Zenoh's own thread, without one in between."""

        def callback(item: Any) -> None:
            if not self._loop.is_closed():
                self._loop.call_soon_threadsafe(handler, item)

        return zenoh.handlers.Callback(callback, indirect=False)


class _Publisher:
    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher

    def put(self, payload: bytes) -> None:
        try:
            self._publisher.put(payload)
        except zenoh.ZError as error:
            raise TransportError(str(error)) from error


class _Query:
    def __init__(self, query: zenoh.Query) -> None:
        self._query = query

    @property
    def payload(self) -> bytes:
        return b"" if self._query.payload is None else self._query.payload.to_bytes()

    @property
    def traceparent(self) -> bytes | None:
        attached = self._query.attachment
        return None if attached is None or len(attached) > traceparent.MAX_BYTES else attached.to_bytes()

    @property
    def part(self) -> parts.PartRequest | None:
        attached = self._query.attachment
        if attached is None or len(attached) > parts.MAX_ATTACHMENT_BYTES:
            return None
        return parts.parse_request(attached.to_bytes())

    def reply(self, key: str, payload: bytes, head: parts.PartHead | None = None) -> None:
        with self._ended() as query:
            query.reply(key, payload, attachment=None if head is None else head.encode())

    def refuse(self, reason: bytes) -> None:
        with self._ended() as query:
            query.reply_err(reason)

    @contextmanager
    def _ended(self) -> Iterator[zenoh.Query]:
        try:
            with self._query as query:  # dropping the query ends it for its sender
                yield query
        except zenoh.ZError as error:
            raise TransportError(str(error)) from error
