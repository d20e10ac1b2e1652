"""Zenoh ↔ agents; the only module of the agent that imports zenoh. Its callbacks only hand over to the event loop."""

import asyncio
import json
import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Any, Literal, NamedTuple, Self

import zenoh

from agents.gateways import Gateways
from agents.meshes import MeshError
from agents.robot import PictureError
from agents.tracing import Tracing
from agents.wire import traceparent
from agents.wire.access import of_agent
from agents.wire.keys import Keys
from agents.wire.transport import TRANSPORT
from agents.wire.trust import Credentials

_log = logging.getLogger(__name__)

_OPEN_TIMEOUT_MS = 1_000
_RETRY_S = 0.3
_LOOK_TIMEOUT_S = 1.0
_MOST_WAITING = {"mesh": 32, "picture": 8}


_Slow = Literal["mesh", "picture"]


class DuplicateNameError(Exception):
    """Another agent with the same robot name is alive; the message says which run of it."""


def configuration(
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    lease_ms: int,
    credentials: Credentials | None = None,
    keys: Keys | None = None,
) -> zenoh.Config:
    """A client of the endpoints in ``connect``; a peer when it listens itself. Multicast scouting is off.

    A peer with ``credentials`` takes commands, under ``keys``, from those alone who prove to be gateways or routers.
    """
    config = zenoh.Config()
    values: dict[str, object] = {
        **TRANSPORT,
        # Clients see each other through one router or peer, so a second agent of the same name is noticed.
        "mode": "peer" if listen else "client",
        "connect/endpoints": list(connect),
        "connect/timeout_ms": _OPEN_TIMEOUT_MS,
        "connect/exit_on_failure": not listen,
        # A gateway that was away for long is to find its robots within two seconds as well; zenoh's own is 4 s.
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 1.5},
        "listen/endpoints": list(listen),
        "transport/link/tx/lease": lease_ms,
    }
    if credentials is not None:
        values |= credentials.configuration()
        if listen:
            values["access_control"] = of_agent(keys or Keys())
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
) -> AsyncIterator[zenoh.Session]:
    """A session that several links may share. Waits until an endpoint answers, however long that takes.

    Afterwards zenoh itself reconnects and declares everything again. A wrong endpoint syntax is a zenoh.ZError.
    """
    config = configuration(connect, listen, lease_ms, credentials, keys)
    session, waiting = None, False
    while session is None:
        try:
            # A fresh thread per try: opening blocks for at most _OPEN_TIMEOUT_MS and cannot be cancelled.
            session = await asyncio.to_thread(zenoh.open, config)
        except zenoh.ZError as error:
            if not waiting:
                # An agent may well be there before its gateway; zenoh's text ends in a path of its own sources.
                reason = str(error).partition(" at /")[0]
                _log.info("nothing answers at %s yet (%s); trying on", ", ".join(connect) or "no endpoint", reason)
            waiting = True
            await asyncio.sleep(_RETRY_S)
    _log.info("connected to %s", ", ".join(connect) or "peers")
    try:
        yield session
    finally:
        await asyncio.to_thread(session.close)


class ZenohLink:
    """One robot on a shared session: ``async with ZenohLink(...) as link`` declares it, leaving undeclares it.

    ``on_command`` and ``on_stop`` are called on the event loop with the payload and return the payload of the reply,
    ``on_mesh`` and ``on_picture`` in a thread, each one call after another; they may raise MeshError and PictureError.
    Entering raises DuplicateNameError when the name is taken for longer than ``lease_ms``: a token that outlives its
    killed agent is gone by then.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        *,
        robot: str,
        incarnation: int,
        description: bytes,
        on_command: Callable[[bytes], bytes],
        on_stop: Callable[[bytes], bytes],
        on_mesh: Callable[[bytes], bytes] | None = None,
        on_picture: Callable[[bytes], bytes] | None = None,
        lease_ms: int = 2_000,
        tracing: Tracing | None = None,
    ) -> None:
        self._session, self._keys = session, keys
        self._robot, self._incarnation, self._lease_ms = robot, incarnation, lease_ms
        self._description = description
        self._answers = {"command": on_command, "stop": on_stop}
        self._tracing = tracing
        slow: dict[_Slow, Callable[[bytes], bytes] | None] = {"mesh": on_mesh, "picture": on_picture}
        self._slow = {kind: _Slowly(read) for kind, read in slow.items() if read is not None}
        self._gateways = Gateways(robot)
        self._dropping = False
        self._declared = ExitStack()

    @property
    def gateway_present(self) -> bool:
        return self._gateways.present

    @property
    def arrivals(self) -> int:
        return self._gateways.arrivals

    def watch_gateways(self, period_s: float) -> None:
        self._gateways.watch(time.monotonic(), period_s)

    async def __aenter__(self) -> Self:
        await self._wait_for_name()
        try:
            self._declare(asyncio.get_running_loop())
            # Two that started in the same instant saw nobody: the elder run keeps the name.
            elder = [other for other in await self._others() if other < self._incarnation]
            if elder:
                raise self._duplicate(elder[0])
        except BaseException:
            self._declared.close()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._declared.close()

    def publish_state(self, payload: bytes) -> None:
        self._put(self._states, payload)

    def publish_progress(self, payload: bytes, final: bool) -> None:
        self._put(self._ends if final else self._progress, payload)

    def _put(self, publisher: Any, payload: bytes) -> None:
        try:
            publisher.put(payload)
            self._dropping = False
        except zenoh.ZError as error:
            if not self._dropping:
                _log.warning("%s: publications are dropped: %s", self._robot, error)
            self._dropping = True

    def _declare(self, loop: asyncio.AbstractEventLoop) -> None:
        declare, session, keys, robot = self._declared.enter_context, self._session, self._keys, self._robot
        # A frame is worth nothing once the next one is there: drop rather than wait. How a motion ended must arrive.
        self._states = declare(
            session.declare_publisher(
                keys.robot(robot, "state"),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA,
                express=False,
            )
        )
        self._progress, self._ends = (
            declare(session.declare_publisher(keys.robot(robot, "progress"), congestion_control=control, express=True))
            for control in (zenoh.CongestionControl.DROP, zenoh.CongestionControl.BLOCK)
        )

        def hand_over(handler: Callable[[Any], None]) -> Callable[[Any], None]:
            def callback(item: Any) -> None:
                if not loop.is_closed():
                    loop.call_soon_threadsafe(handler, item)

            return callback

        declare(
            session.declare_queryable(
                keys.robot(robot, "description"), hand_over(self._answer_description), complete=True
            )
        )
        kinds: tuple[Literal["command"], Literal["stop"]] = ("command", "stop")
        for kind in kinds:
            answer = partial(self._answer, kind)
            declare(session.declare_queryable(keys.robot(robot, kind), hand_over(answer), complete=True))
        for slow in self._slow:
            key = keys.robot(robot, slow)
            declare(session.declare_queryable(key, hand_over(partial(self._answer_slowly, slow)), complete=True))
        declare(session.declare_subscriber(keys.all_heartbeats, hand_over(self._note_heartbeat)))
        declare(session.liveliness().declare_subscriber(keys.all_gateways, hand_over(self._note_gateway), history=True))
        # Last: whoever sees the robot can ask it.
        declare(session.liveliness().declare_token(keys.presence(robot, self._incarnation)))

    def _note_gateway(self, sample: zenoh.Sample) -> None:
        note = self._gateways.appeared if sample.kind == zenoh.SampleKind.PUT else self._gateways.left
        self._note(note, sample)

    def _note_heartbeat(self, sample: zenoh.Sample) -> None:
        self._note(self._gateways.heard, sample)

    def _note(self, note: Callable[[str, float], None], sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        try:
            gateway = self._keys.gateway_of(key)
        except ValueError as error:
            _log.debug("%s: ignored: %s", self._robot, error)
            return
        note(gateway, time.monotonic())

    def _answer_description(self, query: zenoh.Query) -> None:
        self._reply(query, self._keys.robot(self._robot, "description"), self._description)

    def _answer(self, kind: Literal["command", "stop"], query: zenoh.Query) -> None:
        payload = b"" if query.payload is None else query.payload.to_bytes()
        answer = self._answers[kind]
        if self._tracing is None:
            reply = answer(payload)
        else:
            reply = self._tracing.take(kind, self._robot, _attached(query), payload, answer)
        self._reply(query, self._keys.robot(self._robot, kind), reply)

    def _answer_slowly(self, kind: _Slow, query: zenoh.Query) -> None:
        """Off the event loop: a slow disk, a slow renderer or a slow gateway must not hold up the robot."""
        slowly = self._slow[kind]
        if len(slowly.waiting) >= _MOST_WAITING[kind]:
            self._reply(query, self._keys.robot(self._robot, kind), _Refusal(f"too much is asked for: {kind}"))
            return
        task = asyncio.get_running_loop().create_task(self._send_slowly(kind, slowly, query))
        slowly.waiting.add(task)
        task.add_done_callback(slowly.waiting.discard)

    async def _send_slowly(self, kind: _Slow, slowly: "_Slowly", query: zenoh.Query) -> None:
        async with slowly.one:
            await asyncio.to_thread(self._read_and_reply, kind, slowly.read, query)

    def _read_and_reply(self, kind: _Slow, read: Callable[[bytes], bytes], query: zenoh.Query) -> None:
        try:
            content: bytes | _Refusal = read(b"" if query.payload is None else query.payload.to_bytes())
        except (MeshError, PictureError) as error:
            _log.info("%s: no %s: %s", self._robot, kind, error)
            content = _Refusal(str(error))
        self._reply(query, self._keys.robot(self._robot, kind), content)

    def _reply(self, query: zenoh.Query, key: str, payload: "bytes | _Refusal") -> None:
        try:
            with query:  # dropping the query ends it for the asker
                if isinstance(payload, _Refusal):
                    query.reply_err(payload.reason.encode())
                else:
                    query.reply(key, payload)
        except zenoh.ZError as error:
            _log.warning("%s: a reply on %s could not be sent: %s", self._robot, key, error)

    async def _wait_for_name(self) -> None:
        if not await self._others():
            return
        _log.warning(
            "%s: an agent of this name is known; waiting %d ms whether it is alive", self._robot, self._lease_ms
        )
        await asyncio.sleep(1.2 * self._lease_ms / 1000.0)
        others = await self._others()
        if others:
            raise self._duplicate(others[0])

    async def _others(self) -> list[int]:
        """The other incarnations of this robot that are alive now, the eldest first."""

        def look() -> list[str]:
            replies = self._session.liveliness().get(self._keys.presence_of(self._robot), timeout=_LOOK_TIMEOUT_S)
            return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

        found = [_incarnation(self._keys, key) for key in await asyncio.to_thread(look)]
        return sorted(incarnation for incarnation in found if incarnation not in (None, self._incarnation))

    def _duplicate(self, incarnation: int) -> DuplicateNameError:
        return DuplicateNameError(
            f"the robot name {self._robot!r} is taken: another agent (run {incarnation}) is alive; "
            "stop it or choose another name"
        )


class _Refusal(NamedTuple):
    """Why a question has no answer."""

    reason: str


@dataclass
class _Slowly:
    """Questions that are answered in threads, one at a time."""

    read: Callable[[bytes], bytes]
    one: asyncio.Lock = field(default_factory=asyncio.Lock)
    waiting: set[asyncio.Task[None]] = field(default_factory=set)


def _attached(query: zenoh.Query) -> bytes | None:
    """What may be a traceparent."""
    attached = query.attachment
    return None if attached is None or len(attached) > traceparent.MAX_BYTES else attached.to_bytes()


def _incarnation(keys: Keys, key: str) -> int | None:
    """The run whose token this is; None for a token that is none of the protocol, which is nobody's."""
    try:
        return keys.parse(key).incarnation
    except ValueError:
        return None
