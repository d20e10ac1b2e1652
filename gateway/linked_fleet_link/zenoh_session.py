"""The gateway's session on Zenoh; the only module of the gateway that imports zenoh.

Zenoh calls back on its own threads. Calls that may block on a congested connection run in a small thread pool. The
queries of commands, and the first of a stop of one robot, may not block: they are dropped after a millisecond.
"""

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from pathlib import Path
from typing import Any, TypeVar

import zenoh

from linked_fleet_agent.wire import parts
from linked_fleet_agent.wire.transport import GATEWAY_LEASE_MS, TRANSPORT
from linked_fleet_agent.wire.trust import Credentials
from linked_fleet_link.transport import (
    MAX_ERROR_BYTES,
    Answer,
    LinkError,
    Question,
    TransportError,
    readable_error,
)
from linked_fleet_state.events import MAX_KEYS, Payload


def trust(credentials: Credentials | None, access_file: str) -> dict[str, object]:
    """Return the settings of mutual TLS and access control. Raises ValueError for an unusable file."""
    values = credentials.configuration() if credentials is not None else {}
    if access_file:
        try:
            values["access_control"] = json.loads(Path(access_file).read_text())
        except OSError as error:
            raise ValueError(f"LINKED_FLEET_ZENOH_ACCESS: {access_file} cannot be read: {error.strerror}") from None
        except ValueError as error:
            raise ValueError(f"LINKED_FLEET_ZENOH_ACCESS: {access_file} is no JSON: {error}") from None
    return values


def settings(listen: tuple[str, ...], connect: tuple[str, ...], trust: Mapping[str, object]) -> dict[str, object]:
    """Return the session settings.

    Router mode, because a peer receives nothing from other peers through a router, and a client cannot open without a
    router.
    """
    return {
        **TRANSPORT,
        **trust,
        "mode": "router",
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5},
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": GATEWAY_LEASE_MS,
    }


def port_is_taken(error: Exception) -> bool:
    return "os error 98" in str(error)


def open_failure(error: Exception, listen: tuple[str, ...]) -> str:
    """Return one line for people."""
    if port_is_taken(error):
        return f"a port of {', '.join(listen)} is taken by another process"
    return f"Zenoh does not open: {str(error).splitlines()[0].partition(' at /')[0]}"


_T = TypeVar("_T")

BIND_PATIENCE_S = 2.0
_BIND_PAUSE_S = 0.1
_WAITING = 4096  # frames that Zenoh buffers for the reading thread; beyond that its connections wait
_NAP_S = 0.001
"""Wait this long for more frames, so that one wake-up of the thread serves a batch."""

_PRIORITIES = {
    "real time": zenoh.Priority.REAL_TIME,
    "data": zenoh.Priority.DATA,
    "background": zenoh.Priority.BACKGROUND,
}


async def open_session(
    listen: tuple[str, ...], connect: tuple[str, ...], trust: Mapping[str, object]
) -> "ZenohSession":
    """Open a Zenoh router. Raises LinkError."""
    config = zenoh.Config()
    for name, value in settings(listen, connect, trust).items():
        try:
            config.insert_json5(name, json.dumps(value))
        except zenoh.ZError as error:
            raise LinkError(f"Zenoh does not take {name}: {str(error).splitlines()[0]}") from error
    loop = asyncio.get_running_loop()
    patience = loop.time() + BIND_PATIENCE_S
    while True:
        try:
            return ZenohSession(await asyncio.to_thread(zenoh.open, config), connects=bool(connect))
        except zenoh.ZError as error:
            # A gateway that was just replaced may hold the port a moment longer.
            if not port_is_taken(error) or loop.time() > patience:
                raise LinkError(open_failure(error, listen)) from error
        await asyncio.sleep(_BIND_PAUSE_S)


class ZenohSession:
    """Implements ``linked_fleet_link.transport.Session``. Create and use it on the event loop."""

    def __init__(self, session: zenoh.Session, connects: bool) -> None:
        self._session, self._connects = session, connects
        self._loop = asyncio.get_running_loop()
        self._context = copy_context()  # that of the gateway, for what threads of Zenoh hand over
        self._threads = ThreadPoolExecutor(max_workers=8, thread_name_prefix="link")
        # Stops have threads of their own, so that they never wait behind a call on a congested connection.
        self._stop_threads = ThreadPoolExecutor(max_workers=16, thread_name_prefix="stop")
        self._declared: dict[Callable[[], Any], Any] = {}  # declarations last as long as they are referenced
        self._token_subscribers: list[object] = []
        self._routes: dict[str, zenoh.KeyExpr] = {}

    @property
    def connected(self) -> bool:
        return not self._connects or bool(self._session.info.transports())

    async def subscribe_frames(self, key: str, limit: int, hear: Callable[[str, Payload], None]) -> None:
        def declare() -> Any:
            frames = self._session.declare_subscriber(key, zenoh.handlers.FifoChannel(_WAITING))
            arguments = (_read, frames.handler, limit, hear)
            threading.Thread(target=self._context.copy().run, args=arguments, name="frames", daemon=True).start()
            return frames

        await self._declare(declare)

    async def subscribe(self, key: str, limit: int, hear: Callable[[str, Payload], None]) -> None:
        def take(sample: zenoh.Sample) -> None:
            hear(str(sample.key_expr), _bounded(sample.payload, limit))

        await self._declare(lambda: self._session.declare_subscriber(key, _at_once(take)))

    async def subscribe_tokens(self, key: str, hear: Callable[[str, bool], None]) -> None:
        def take(sample: zenoh.Sample) -> None:
            hear(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        def declare() -> None:
            tokens = self._session.liveliness().declare_subscriber(key, _at_once(take), history=True)
            self._token_subscribers.append(tokens)

        await self._in_thread(declare)

    async def declare_token(self, key: str) -> None:
        await self._declare(lambda: self._session.liveliness().declare_token(key))

    async def list_tokens(self, key: str, timeout_s: float, read: Callable[[Iterable[str]], _T]) -> tuple[_T, bool]:
        def ask() -> tuple[_T, bool]:
            # Known tokens are reported before ``get`` returns: a Zenoh channel is full at 256 and would block it.
            replies, over = list[zenoh.Reply](), threading.Event()
            handler = _at_once(replies.append, over.set)
            self._session.liveliness().get(key, handler, timeout=timeout_s)
            complete = over.wait(timeout_s)
            found = [reply.ok for reply in replies.copy()]
            return read(str(token.key_expr) for token in found if token is not None), complete and None not in found

        return await self._in_thread(ask)

    async def redeclare(self) -> None:
        def again() -> None:
            for declare, declared in list(self._declared.items()):
                declared.undeclare()
                self._declared[declare] = declare()

        await self._in_thread(again)

    def declare_heartbeat(self, key: str) -> Callable[[], None]:
        # No other message has this priority, so its queue is its own: congestion neither delays a heartbeat nor blocks
        # the event loop.
        publisher = self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
        )

        def send() -> None:
            try:
                publisher.put(b"")
            except zenoh.ZError as error:
                raise TransportError(str(error)) from error

        return send

    def put_newest(self, key: str, payload: bytes) -> None:
        # As for heartbeats, the queue of this priority is its own, so that what waits in others delays nothing.
        try:
            self._session.put(
                self._routes.get(key, key),
                payload,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.INTERACTIVE_LOW,
                express=True,
            )
        except zenoh.ZError as error:
            raise TransportError(str(error)) from error

    async def ask(self, question: Question, hear: Callable[[Answer | None], None]) -> float:
        def hand_over(answer: Answer | None) -> None:
            with contextlib.suppress(RuntimeError):  # the loop was closed while the query was running
                self._loop.call_soon_threadsafe(hear, answer, context=self._context)

        if not question.blocking and question.part is None:
            return self._get(question, hand_over)
        threads = self._stop_threads if question.priority == "real time" else self._threads
        return await self._loop.run_in_executor(threads, self._get, question, hand_over)

    def _get(self, question: Question, hand_over: Callable[[Answer | None], None]) -> float:
        begin_s = time.thread_time()
        handler = _at_once(lambda reply: hand_over(_answer(reply, question)), lambda: hand_over(None))
        self._session.get(
            self._routes.get(question.key, question.key),
            handler,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,  # two runs of an agent answer under one key
            timeout=question.timeout_s,
            payload=question.payload,
            attachment=question.traceparent if question.part is None else question.part.encode(),
            express=True,
            priority=_PRIORITIES[question.priority],
            congestion_control=zenoh.CongestionControl.BLOCK if question.blocking else zenoh.CongestionControl.DROP,
        )
        return time.thread_time() - begin_s

    async def keep_route(self, key: str) -> None:
        def keep() -> None:
            if key not in self._routes and len(self._routes) < MAX_KEYS:
                self._routes[key] = self._session.declare_keyexpr(key)

        if key not in self._routes:
            await self._in_thread(keep)

    async def close(self) -> None:
        if self._session.is_closed():
            return
        try:
            await self._in_thread(self._session.close)
        except zenoh.ZError as error:
            raise TransportError(str(error)) from error
        finally:
            self._threads.shutdown(wait=False)
            self._stop_threads.shutdown(wait=False)

    async def _declare(self, declare: Callable[[], Any]) -> None:
        self._declared[declare] = await self._in_thread(declare)

    async def _in_thread(self, call: Callable[..., _T], *arguments: object) -> _T:
        return await self._loop.run_in_executor(self._threads, call, *arguments)


def _read(frames: Any, limit: int, hear: Callable[[str, Payload], None]) -> None:
    with contextlib.suppress(zenoh.ZError):  # the subscriber is undeclared
        while True:
            sample: zenoh.Sample | None = frames.recv()
            while sample is not None:
                hear(str(sample.key_expr), _bounded(sample.payload, limit))
                sample = frames.try_recv()
            time.sleep(_NAP_S)


def _at_once(take: Callable[[Any], None], drop: Callable[[], None] | None = None) -> Any:
    """Return a handler that Zenoh calls on its own thread; by default it would wake a thread of Python's for it."""
    return zenoh.handlers.Callback(take, drop=drop, indirect=False)


def _bounded(payload: zenoh.ZBytes, limit: int) -> Payload:
    """Return the payload, or its length if that is above the limit, without copying it."""
    size = len(payload)
    return payload.to_bytes() if size <= limit else size


def _answer(reply: zenoh.Reply, question: Question) -> Answer:
    if reply.ok is None:
        said = None if reply.err is None else _bounded(reply.err.payload, MAX_ERROR_BYTES)
        return Answer(None, question.key, error=readable_error(said) if isinstance(said, bytes) else "")
    return Answer(_bounded(reply.ok.payload, question.limit), str(reply.ok.key_expr), _head(reply.ok.attachment))


def _head(attachment: zenoh.ZBytes | None) -> parts.PartHead | None:
    if attachment is None or len(attachment) > parts.MAX_ATTACHMENT_BYTES:
        return None
    return parts.parse_head(attachment.to_bytes())
