"""The gateway's side of Zenoh: presence, frames and progress come in, commands and queries go out.

It reaches Zenoh only through ``linked_fleet_link.transport.Session``.
"""

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Collection, Iterable
from typing import Literal, Self, TypeVar

from linked_fleet_agent.wire.codec import encode
from linked_fleet_agent.wire.components import Operate, Sample
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import (
    Accepted,
    Command,
    Progress,
    Refused,
    Reply,
    Stop,
)
from linked_fleet_link.discovery import Discovery, Judge
from linked_fleet_link.heartbeat import Heartbeat
from linked_fleet_link.incoming import Hear, Incoming, OfComponents
from linked_fleet_link.long_replies import LongReplies
from linked_fleet_link.transport import Question, Session, TransportError, ask
from linked_fleet_runtime.log import child_span
from linked_fleet_state.answers import read_reply
from linked_fleet_state.events import Event, Frames
from linked_fleet_state.presence import PresenceCheck, Token

_log = logging.getLogger(__name__)
T = TypeVar("T")

MAX_DESCRIPTION_BYTES = 9_000_000
MAX_REPLY_BYTES = 65_536
DESCRIPTION_TIMEOUT_S = 2.0
LISTING_TIMEOUT_S = 5.0
ASK_AGAIN_S = 0.05
"""Delay before a stop without reply, or a command that reached nobody, is sent again."""


class NoAnswer(Exception):  # noqa: N818 -- an outcome, not a defect
    """No usable reply arrived; it is unknown if a command was executed. ``reason`` is a sentence."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class FleetLink:
    """An open link, as an async context manager. Entering raises what ``open_session`` raises.

    ``on_events`` and ``on_progress`` are called on the event loop, one batch at a time. ``frames`` may store frames
    without an event.
    """

    def __init__(
        self,
        keys: Keys,
        gateway_name: str,
        open_session: Callable[[], Awaitable[Session]],
        on_events: Callable[[list[Event]], None],
        on_progress: Callable[[str, Progress], None],
        frames: Frames | None = None,
    ) -> None:
        self._keys = keys
        self._gateway_name = gateway_name
        self._open_session = open_session
        self._frames = frames or Frames()
        self._on_events = on_events
        self._on_progress = on_progress
        self._listens = False
        self.listeners: dict[OfComponents, Hear] = {}
        """The listeners to messages about components. Filled before ``join``."""

    @property
    def is_connected(self) -> bool:
        """True if robots can be heard; a gateway that connects to routers must be connected to one."""
        return self._listens and self._session.connected

    @property
    def malformed_counts(self) -> dict[str, int]:
        """Number of refused messages by robot or, for a key without one, by key."""
        return dict(self._incoming.complaints.counts)

    @property
    def undescribed_count(self) -> int:
        """Number of robots with a presence token that have not described themselves."""
        return self._discovery.undescribed_count

    async def __aenter__(self) -> Self:
        self._discovery = Discovery(
            self._ask_description, self._list_tokens, self._on_events, lambda: self._heartbeat.send_now(),
            lambda: self._session.redeclare(),
        )  # fmt: skip
        self._incoming = Incoming(
            self._keys, self._frames, self._discovery, self._on_events, self._on_progress, self.listeners
        )
        self._session = await self._open_session()
        self._long_replies = LongReplies(self._session)
        self._heartbeat = Heartbeat(self._session, self._keys.heartbeat(self._gateway_name))
        return self

    async def join(self) -> None:
        """Become visible to robots and listen to them; until then the link is open but silent.

        Subscriptions precede the token, so that no message is missed.
        """
        await self._incoming.declare(self._session)
        await self._session.declare_token(self._keys.gateway(self._gateway_name))
        self._listens = True
        self._heartbeat.start()

    def verify_presence(self, check: PresenceCheck) -> None:
        """Query if a run is alive."""
        self._discovery.verify_presence(check)

    async def list_robots(self, timeout_s: float) -> set[str]:
        """Return the names of present robots, as far as known within ``timeout_s``."""
        tokens, _ = await self._list_tokens(timeout_s)
        return {robot for robot, _ in tokens}

    async def __aexit__(self, *_: object) -> None:
        self._heartbeat.close()
        self._incoming.close()
        await self._discovery.close()
        try:
            await self._session.close()
        except TransportError as error:
            _log.warning("the Zenoh session did not close cleanly: %s", error)

    def reject(self, robot: str, reason: object) -> None:
        """Count something that a robot said and that is refused."""
        self._incoming.complaints.add(robot, reason)

    async def command(self, robot: str, command: Command | Operate, timeout_s: float) -> Reply:
        """Send a command, or a request to a component, and return the agent's reply.

        Raises NoAnswer if none arrives within ``timeout_s``.

        A command that reached nobody is sent once more after ``ASK_AGAIN_S``, because an agent that renews its
        declarations has no queryable for a moment. An agent executes a command once, however often it arrives.
        """
        refusals: list[Reply] = []
        reasons = [f"no agent takes commands for robot {robot!r}"]
        answers = 0

        def judge(answer: bytes | str, _: str) -> Reply | None:
            nonlocal answers
            answers += 1
            reply, reason = read_reply(answer, command.id)
            if isinstance(reply, Refused) and reply.code == "incarnation":
                refusals.append(reply)  # from another run; the addressed one may still answer
                return None
            reasons.append(reason)
            return reply

        async def send(question: Question) -> Reply | None:
            reply: Reply | None = await ask(self._session, question, judge)
            if answers:
                return reply
            await asyncio.sleep(ASK_AGAIN_S)
            reply = await ask(self._session, question, judge)
            if isinstance(reply, Refused) and reply.code == "repeated":
                reasons.append(f"robot {robot!r} took the command, and its reply was lost")
                return None
            return reply

        reply: Reply | None = None
        about = {"robot": robot, "command": command.id} | ({} if command.rehearsal else {"invocation": command.id})
        with child_span("send command", is_client=True, **about) as span:
            traceparent = None if span is None else span.traceparent
            try:
                key = self._keys.robot(robot, "command" if isinstance(command, Command) else "operate")
                question = Question(
                    key, encode(command), timeout_s, MAX_REPLY_BYTES, blocking=False, traceparent=traceparent
                )
                async with asyncio.timeout(timeout_s):
                    reply = await send(question)
            except TimeoutError:
                reasons.append(f"robot {robot!r} did not answer within {timeout_s} s")
            reply = reply or next(iter(refusals), None)
            if span is not None:
                span.record_reply(reply)
            if reply is None:
                raise NoAnswer(reasons[-1])
        await self._session.keep_route(key)
        return reply

    async def prepare_samples(self, robot: str) -> None:
        """Cache the route of the samples of a robot."""
        await self._session.keep_route(self._keys.robot(robot, "sample"))

    def send_sample(self, robot: str, sample: Sample) -> bool:
        """Send a sample of a stream, which congestion drops. Return False if the session does not take it."""
        try:
            self._session.put_newest(self._keys.robot(robot, "sample"), encode(sample))
        except TransportError as error:
            _log.info("robot %s: a sample is dropped: %s", robot, error)
            return False
        return True

    async def stop(
        self,
        robots: Collection[str] | None,
        stop: Stop,
        timeout_s: float,
        online: Collection[str] = (),
        on_reply: Callable[[str, Reply], None] = lambda robot, reply: None,
    ) -> dict[str, Reply]:
        """Stop these robots, or all. Return the replies that arrive within ``timeout_s``, by robot.

        ``on_reply`` is called for each of them as it arrives.

        All are queried concurrently. The named ones or, for a stop of all, those ``online`` are queried once more if
        they have not replied within ``ASK_AGAIN_S``, because an agent that renews its declarations has no queryable for
        a moment. The first query of a single robot is sent at once, and the others by threads, where they may wait for
        a congested connection.
        """
        replies: dict[str, Reply] = {}
        expected = online if robots is None else robots
        (only,) = robots if robots is not None and len(robots) == 1 else (None,)

        def note(answer: bytes | str, key: str) -> Reply | None:
            reply, reason = read_reply(answer, stop.id)
            robot = self._incoming.parse(key) if reply is not None else None
            if reply is None:
                self._incoming.complaints.add(key, reason)
            elif robot is not None and not isinstance(replies.get(robot.robot), Accepted):  # two runs may answer
                replies[robot.robot] = reply
                on_reply(robot.robot, reply)
            return reply if only is not None and isinstance(reply, Accepted) else None

        async def send(key: str, traceparent: bytes | None, blocking: bool) -> None:
            question = Question(
                key, encode(stop), timeout_s, MAX_REPLY_BYTES, priority="real time", blocking=blocking,
                traceparent=traceparent,
            )  # fmt: skip
            with contextlib.suppress(TimeoutError):
                await ask(self._session, question, note)

        async def send_again(traceparent: bytes | None, wait_s: float) -> None:
            await asyncio.sleep(wait_s)
            silent = [self._keys.robot(name, "stop") for name in expected if name not in replies]
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(timeout_s - ASK_AGAIN_S):
                    await asyncio.gather(*(send(key, traceparent, blocking=True) for key in silent))

        again: asyncio.Task[None] | None = None

        def begin_again(traceparent: bytes | None, wait_s: float) -> asyncio.Task[None]:
            nonlocal again
            again = again or asyncio.create_task(send_again(traceparent, wait_s))
            return again

        about = {"command": stop.id} | ({} if stop.rehearsal else {"invocation": stop.command or stop.id})
        with child_span("send stop", is_client=True, **about, **({} if only is None else {"robot": only})) as span:
            traceparent = None if span is None else span.traceparent
            timer = asyncio.get_running_loop().call_later(ASK_AGAIN_S, begin_again, traceparent, 0.0)
            try:
                if only is not None:
                    await send(self._keys.robot(only, "stop"), traceparent, blocking=False)
                elif robots is None:
                    await send(self._keys.all_stops, traceparent, blocking=True)
                else:
                    keys = [self._keys.robot(name, "stop") for name in robots]
                    await asyncio.gather(*(send(key, traceparent, blocking=True) for key in keys))
                if any(name not in replies for name in expected):
                    await begin_again(traceparent, timer.when() - asyncio.get_running_loop().time())
            finally:
                timer.cancel()
                if again is not None:
                    again.cancel()
            if span is not None and only is not None:
                span.record_reply(replies.get(only))
        return replies

    async def ask_agent(
        self,
        robot: str,
        kind: Literal["mesh", "picture", "values"],
        payload: bytes | None,
        most_bytes: int,
        timeout_s: float,
        read: Callable[[bytes | str], tuple[T | None, str]],
        none: str,
    ) -> T:
        """Ask the agent of a robot for something that may wait: what moves and what is measured overtakes it.

        ``read`` gets an answer, or a sentence why there is none, and returns its meaning, or None and the reason.
        A long answer comes in parts (``long_replies``); ``timeout_s`` is for the first of them. Raises NoAnswer
        with the last reason, ``none`` if nobody has answered. Answers that mean nothing are counted.
        """
        reasons = [none]

        answers = 0

        def judge(answer: bytes | str, sender: str) -> T | None:
            nonlocal answers
            answers += 1
            found, reason = read(answer)
            if found is None and isinstance(answer, bytes):
                self._incoming.complaints.add(sender, reason)
            reasons.append(reason)
            return found

        question = Question(self._keys.robot(robot, kind), payload, timeout_s, most_bytes, priority="background")
        found: T | None = None
        try:
            found = await self._long_replies.ask(question, judge, resume=kind == "mesh")
            if not answers:  # congestion drops parts, and an agent that renews its declarations has no queryable
                await asyncio.sleep(ASK_AGAIN_S)
                found = await self._long_replies.ask(question, judge, resume=kind == "mesh")
        except TimeoutError as error:
            reasons.append(str(error) or f"robot {robot!r} did not answer within {timeout_s} s")
        if found is None:
            raise NoAnswer(reasons[-1])
        return found

    async def _list_tokens(self, timeout_s: float = LISTING_TIMEOUT_S) -> tuple[list[Token], bool]:
        """Return the tokens of all runs, the highest first, and True if the list is certainly complete."""
        return await self._session.list_tokens(self._keys.all_presence, timeout_s, self._read_tokens)

    def _read_tokens(self, keys: Iterable[str]) -> list[Token]:
        found = list[Token]()
        for key in keys:
            with contextlib.suppress(ValueError):  # the sender was counted when the token arrived
                parsed = self._keys.parse(key)
                if parsed.incarnation is not None:
                    found.append((parsed.robot, parsed.incarnation))
        return sorted(found, reverse=True)

    async def _ask_description(self, robot: str, judge: Judge) -> None:
        """Send one query. Raises TimeoutError."""
        question = Question(self._keys.robot(robot, "description"), None, DESCRIPTION_TIMEOUT_S, MAX_DESCRIPTION_BYTES)
        if await self._long_replies.ask(question, judge, self._discovery.record_send_time) is not None:
            await self._session.keep_route(self._keys.robot(robot, "state"))
