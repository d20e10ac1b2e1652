"""The gateway's end of Zenoh: presence, frames and progress come in, commands and questions go out.

With ``heartbeat.py``, ``incoming.py`` and ``questions.py`` all of the gateway that imports zenoh. Zenoh calls back on
its threads; such a callback only puts a payload where the event loop finds it. Calls that may block on a full
connection happen in a small thread pool.
"""

import asyncio
import contextlib
import json
import logging
import threading
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Any, Self

import zenoh

from agents.wire.codec import encode
from agents.wire.keys import Keys
from agents.wire.messages import (
    WIRE_VERSION,
    Accepted,
    Camera,
    Command,
    Glance,
    Mesh,
    PictureFormat,
    Progress,
    Refused,
    Reply,
    Stop,
)
from gateway.discovery import Discovery, Judge
from gateway.fleet.answers import read_mesh, read_reply
from gateway.fleet.cameras import Picture, read_picture, size_limit
from gateway.fleet.events import Event
from gateway.fleet.frames import Frames
from gateway.fleet.inbox import MAX_KEYS
from gateway.fleet.presence import Token
from gateway.fleet.robot import Robot
from gateway.heartbeat import Heartbeat
from gateway.incoming import Incoming
from gateway.observe.context import step
from gateway.questions import Questions
from gateway.session import open_failure, port_is_taken, settings

_log = logging.getLogger(__name__)

MAX_DESCRIPTION_BYTES = 9_000_000
MAX_REPLY_BYTES = 65_536
DESCRIPTION_TIMEOUT_S = 2.0
LISTING_TIMEOUT_S = 5.0
BIND_PATIENCE_S = 2.0


class LinkError(Exception):
    """The link cannot be opened: a port that is taken or an endpoint that means nothing. One line for a human."""


class NoAnswer(Exception):  # noqa: N818 -- it is an outcome, not a defect
    """No usable answer came; whether a command was executed is unknown. ``reason`` is a sentence."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class FleetLink:
    """An open link, as an async context manager. Raises LinkError on entry.

    ``on_events`` and ``on_progress`` are called in the event loop, one batch after another. ``frames`` may take frames
    without an event. ``trust`` is Zenoh's configuration of who proves what to whom.
    """

    def __init__(
        self,
        keys: Keys,
        gateway_name: str,
        listen: tuple[str, ...],
        connect: tuple[str, ...],
        on_events: Callable[[list[Event]], None],
        on_progress: Callable[[str, Progress], None],
        trust: Mapping[str, object] = MappingProxyType({}),
        frames: Frames | None = None,
    ) -> None:
        self._keys = keys
        self._gateway_name = gateway_name
        self._listen = listen
        self._connect = connect
        self._trust = trust
        self._frames = frames or Frames()
        self._on_events = on_events
        self._on_progress = on_progress
        self._expected: dict[str, zenoh.KeyExpr] = {}
        self._declared: tuple[object, ...] = ()

    @property
    def joined(self) -> bool:
        """Whether robots can be heard: of a gateway that is to connect somewhere, whether anybody is connected."""
        return bool(self._declared) and (not self._connect or bool(self._session.info.transports()))

    @property
    def malformed(self) -> dict[str, int]:
        """How many messages were refused here, by robot or, where the key names none, by key."""
        return dict(self._incoming.complaints.counts)

    @property
    def undescribed(self) -> int:
        """How many robots have a presence token, and have not described themselves."""
        return self._discovery.undescribed

    async def __aenter__(self) -> Self:
        self._loop = asyncio.get_running_loop()
        self._questions = Questions()
        self._discovery = Discovery(
            self._ask_description, self._list_tokens, self._on_events, lambda: self._heartbeat.hasten()
        )
        self._incoming = Incoming(self._keys, self._frames, self._discovery, self._on_events, self._on_progress)
        try:
            self._session = await self._open()
        except BaseException:
            self._questions.close()
            raise
        self._heartbeat = Heartbeat(self._session, self._keys.heartbeat(self._gateway_name))
        return self

    async def join(self) -> None:
        """Be seen by the robots, and hear them; until then the link is open and silent."""
        await self._questions.in_thread(self._declare)
        self._heartbeat.start()

    async def roll_call(self, timeout_s: float) -> set[str]:
        """Names of the robots that are there now, as far as is known within ``timeout_s``."""
        tokens, _ = await self._list_tokens(timeout_s)
        return {robot for robot, _ in tokens}

    async def __aexit__(self, *_: object) -> None:
        self._heartbeat.close()
        self._incoming.close()
        await self._discovery.close()
        try:
            await self._questions.in_thread(self._session.close)
        except zenoh.ZError as error:
            _log.warning("the Zenoh session did not close cleanly: %s", error)
        self._questions.close()

    async def command(self, robot: str, command: Command, timeout_s: float) -> Reply:
        """Send a command and return the agent's reply. Raises NoAnswer when none comes within ``timeout_s``."""
        refusals: list[Reply] = []
        reasons = [f"no agent takes commands for robot {robot!r}"]

        def judge(answer: bytes | str, _: str) -> Reply | None:
            reply, reason = read_reply(answer, command.id)
            if isinstance(reply, Refused) and reply.code == "incarnation":
                refusals.append(reply)  # of another run; the one that is meant may answer as well
                return None
            reasons.append(reason)
            return reply

        reply: Reply | None = None
        about = {"robot": robot, "command": command.id} | ({} if command.rehearsal else {"invocation": command.id})
        with step("send command", asks=True, **about) as span:
            traceparent = None if span is None else span.traceparent
            try:
                key = self._keys.robot(robot, "command")
                reply = await self._questions.ask(
                    self._session, self._expected.get(key, key), timeout_s, MAX_REPLY_BYTES, encode(command), judge,
                    traceparent=traceparent, patient=False,
                )  # fmt: skip
            except TimeoutError:
                reasons.append(f"robot {robot!r} did not answer within {timeout_s} s")
            reply = reply or next(iter(refusals), None)
            if span is not None:
                span.replied(reply)
            if reply is None:
                raise NoAnswer(reasons[-1])
        if key not in self._expected:
            await self._questions.in_thread(self._expect, key)
        return reply

    async def stop(self, robots: Collection[str] | None, stop: Stop, timeout_s: float) -> dict[str, Reply]:
        """Stop these robots, or all there are: what those of them replied that did within ``timeout_s``.

        All are asked at once, and none waits for another.
        """
        replies: dict[str, Reply] = {}

        def note(answer: bytes | str, key: str) -> None:
            reply, reason = read_reply(answer, stop.id)
            robot = self._incoming.parse(key) if reply is not None else None
            if reply is None:
                self._incoming.complaints.add(key, reason)
            elif robot is not None and not isinstance(replies.get(robot.robot), Accepted):  # two runs may answer
                replies[robot.robot] = reply

        async def ask(key: str, traceparent: bytes | None) -> None:
            with contextlib.suppress(TimeoutError):
                await self._questions.ask(
                    self._session,
                    key,
                    timeout_s,
                    MAX_REPLY_BYTES,
                    encode(stop),
                    note,
                    zenoh.Priority.REAL_TIME,
                    traceparent,
                )

        keys = [self._keys.all_stops] if robots is None else [self._keys.robot(name, "stop") for name in robots]
        about = {"command": stop.id} | ({} if stop.rehearsal else {"invocation": stop.command or stop.id})
        (only,) = robots if robots is not None and len(robots) == 1 else (None,)
        with step("send stop", asks=True, **about, **({} if only is None else {"robot": only})) as span:
            traceparent = None if span is None else span.traceparent
            await asyncio.gather(*(ask(key, traceparent) for key in keys))
            if span is not None and only is not None:
                span.replied(replies.get(only))
        return replies

    async def mesh(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        """The bytes, as many as ``mesh`` has, that the agent says are the mesh. Raises NoAnswer."""
        reasons = [f"no agent hands out meshes of robot {robot!r}"]

        def judge(answer: bytes | str, _: str) -> bytes | None:
            content, reason = read_mesh(answer, mesh)
            reasons.append(reason)
            return content

        content: bytes | None = None
        key, asked = self._keys.robot(robot, "mesh"), mesh.sha256.encode()
        try:
            # What moves and what is measured overtakes it.
            content = await self._questions.ask(
                self._session, key, timeout_s, mesh.size, asked, judge, zenoh.Priority.BACKGROUND
            )
        except TimeoutError:
            reasons.append(f"robot {robot!r} did not answer within {timeout_s} s")
        if content is None:
            raise NoAnswer(reasons[-1])
        return content

    async def picture(self, robot: Robot, camera: Camera, format: PictureFormat, timeout_s: float) -> Picture:
        """What a camera sees now. Raises NoAnswer; what is no picture of that camera is counted besides."""
        reasons = [f"no agent shows what robot {robot.name!r} sees"]

        def judge(answer: bytes | str, sender: str) -> Picture | None:
            picture, reason = read_picture(answer, camera, format, robot.incarnation)
            if picture is None and isinstance(answer, bytes):
                self._incoming.complaints.add(sender, reason)
            reasons.append(reason)
            return picture

        picture: Picture | None = None
        key = self._keys.robot(robot.name, "picture")
        question = encode(Glance(version=WIRE_VERSION, camera=camera.name, format=format))
        try:
            picture = await self._questions.ask(
                self._session, key, timeout_s, size_limit(camera), question, judge, zenoh.Priority.BACKGROUND
            )
        except TimeoutError:
            reasons.append(f"robot {robot.name!r} did not answer within {timeout_s} s")
        if picture is None:
            raise NoAnswer(reasons[-1])
        return picture

    async def _open(self) -> zenoh.Session:
        config = zenoh.Config()
        for name, value in settings(self._listen, self._connect, self._trust).items():
            try:
                config.insert_json5(name, json.dumps(value))
            except zenoh.ZError as error:
                raise LinkError(f"Zenoh does not take {name}: {str(error).splitlines()[0]}") from error
        patience = self._loop.time() + BIND_PATIENCE_S
        while True:
            try:
                return await self._questions.in_thread(zenoh.open, config)
            except zenoh.ZError as error:
                # A gateway that was just replaced may hold the port for a moment longer.
                if not port_is_taken(error) or self._loop.time() > patience:
                    raise LinkError(open_failure(error, self._listen)) from error
            await asyncio.sleep(0.1)

    def _declare(self) -> None:
        """The order leaves no gap: whoever sees this gateway, or is seen by it, is already being listened to."""
        listened = self._incoming.declare(self._session)
        token = self._session.liveliness().declare_token(self._keys.gateway(self._gateway_name))
        self._declared = (*listened, token)

    async def _list_tokens(self, timeout_s: float = LISTING_TIMEOUT_S) -> tuple[list[Token], bool]:
        """Tokens of all runs, the highest first, and whether these are all that there are."""

        def ask() -> tuple[list[Token], bool]:
            # Those that are known are told before ``get`` returns: a channel of Zenoh is full at 256, and blocks it.
            replies, over = list[zenoh.Reply](), threading.Event()
            handler: Any = zenoh.handlers.Callback(replies.append, drop=over.set, indirect=False)
            self._session.liveliness().get(self._keys.all_presence, handler, timeout=timeout_s)
            complete = over.wait(timeout_s)
            found = list[Token]()
            for reply in replies.copy():
                complete = complete and reply.ok is not None
                with contextlib.suppress(ValueError):  # who declared it was counted when it came
                    key = self._keys.parse(str(reply.ok.key_expr)) if reply.ok is not None else None
                    if key is not None and key.incarnation is not None:
                        found.append((key.robot, key.incarnation))
            return sorted(found, reverse=True), complete

        return await self._questions.in_thread(ask)

    async def _ask_description(self, robot: str, judge: Judge) -> None:
        """One question. Raises TimeoutError."""
        key, sent = self._keys.robot(robot, "description"), self._discovery.sent
        said = await self._questions.ask(
            self._session, key, DESCRIPTION_TIMEOUT_S, MAX_DESCRIPTION_BYTES, None, judge, sent=sent
        )
        if said is not None:
            await self._questions.in_thread(self._expect, self._keys.robot(robot, "state"))

    def _expect(self, key: str) -> zenoh.KeyExpr | str:
        """Have Zenoh keep the route of a key. Without that it looks for it each time, among the keys of all robots."""
        if key not in self._expected and len(self._expected) < MAX_KEYS:
            self._expected[key] = self._session.declare_keyexpr(key)
        return self._expected.get(key, key)
