"""One robot on a session: its presence, queryables and publications, and the gateways that it sees."""

import asyncio
import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Literal, NamedTuple, Self

from linked_fleet_agent.gateways import GatewayWatch
from linked_fleet_agent.long_replies import HELD_S, LongReplies, PartError, part_of
from linked_fleet_agent.mesh_files import MeshError
from linked_fleet_agent.robot import PictureError
from linked_fleet_agent.tracing import Tracing
from linked_fleet_agent.transport import Publisher, Query, Session, TransportError
from linked_fleet_agent.wire.components import MAX_SAMPLE_BYTES
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.parts import PART_BYTES, PartHead, PartRequest, content_tag

_log = logging.getLogger(__name__)

_LOOK_TIMEOUT_S = 1.0
_LOOKS_EACH_LEASE = 5
_MOST_LEASES = 3  # routers notice the end of a connection after one lease, and later if they are busy
_MOST_WAITING = {"mesh": 32, "picture": 8, "description": 32}


_Slow = Literal["mesh", "picture", "description"]
_Prompt = Literal["command", "stop", "operate", "values"]


class DuplicateNameError(Exception):
    """Another agent with the same robot name is alive; the message gives its incarnation."""


class RobotLink:
    """One robot on a shared session: ``async with RobotLink(...) as link`` declares it, leaving undeclares it.

    ``on_command`` and ``on_stop`` are called on the event loop with the payload and return the payload of the reply;
    so are ``on_operate``, ``on_values`` and ``on_sample``, which a robot with components has.
    ``on_mesh`` and ``on_picture`` are called in a thread, one call of each at a time; they may raise MeshError and
    PictureError. Entering raises DuplicateNameError if the name is still in use after three times ``lease_ms``; by then
    the token of a killed agent has expired, also on a busy machine.
    """

    def __init__(
        self,
        session: Session,
        keys: Keys,
        *,
        robot: str,
        incarnation: int,
        description: bytes,
        on_command: Callable[[bytes], bytes],
        on_stop: Callable[[bytes], bytes],
        on_mesh: Callable[[bytes], bytes] | None = None,
        on_picture: Callable[[bytes], bytes] | None = None,
        on_operate: Callable[[bytes], bytes] | None = None,
        on_values: Callable[[], bytes] | None = None,
        on_sample: Callable[[bytes], None] | None = None,
        lease_ms: int = 2_000,
        tracing: Tracing | None = None,
    ) -> None:
        self._session, self._keys = session, keys
        self._robot, self._incarnation, self._lease_ms = robot, incarnation, lease_ms
        self._description, self._description_tag = description, content_tag(description)
        self._answers: dict[_Prompt, Callable[[bytes], bytes]] = {"command": on_command, "stop": on_stop}
        if on_operate is not None and on_values is not None:
            self._answers |= {"operate": on_operate, "values": lambda _: on_values()}
        self._tracing, self._on_sample = tracing, on_sample
        slow: dict[_Slow, Callable[[bytes], bytes] | None] = {
            "mesh": on_mesh, "picture": on_picture, "description": lambda _: description,
        }  # fmt: skip
        self._slow = {kind: _ThreadedQueries(read) for kind, read in slow.items() if read is not None}
        self._gateways = GatewayWatch(session, keys, robot, self._declare_visible)
        self._dropping = False
        self._declared = ExitStack()
        self._visible: dict[int, ExitStack] = {}

    @property
    def gateway_present(self) -> bool:
        return self._gateways.present

    @property
    def arrivals(self) -> int:
        return self._gateways.arrivals

    def watch_gateways(self, period_s: float) -> None:
        self._gateways.check(period_s)

    async def __aenter__(self) -> Self:
        await self._wait_for_name()
        try:
            self._declare()
            # Two agents that started at the same instant did not see each other: the older run keeps the name.
            elder = [other for other in await self._others() if other < self._incarnation]
            if elder:
                raise self._duplicate(elder[0])
        except BaseException:
            self._undeclare()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._undeclare()

    def publish_state(self, payload: bytes) -> None:
        self._put(self._states, payload)

    def publish_progress(self, payload: bytes, final: bool) -> None:
        self._put(self._ends if final else self._progress, payload)

    def publish_condition(self, payload: bytes) -> None:
        self._put(self._conditions, payload)

    def publish_values(self, payload: bytes) -> None:
        self._put(self._values, payload)

    def publish_event(self, payload: bytes) -> None:
        self._put(self._events, payload)

    def _put(self, publisher: Publisher, payload: bytes) -> None:
        try:
            publisher.put(payload)
            self._dropping = False
        except TransportError as error:
            if not self._dropping:
                _log.warning("%s: publications are dropped: %s", self._robot, error)
            self._dropping = True

    def _declare(self) -> None:
        declare, session, keys, robot = self._declared.enter_context, self._session, self._keys, self._robot
        # A frame is worthless once the next one exists, so it is dropped rather than delayed. The end of a motion must
        # arrive.
        state, progress = keys.robot(robot, "state"), keys.robot(robot, "progress")
        self._states = declare(session.declare_publisher(state, reliable=False, express=False))
        self._progress = declare(session.declare_publisher(progress, reliable=False, express=True))
        self._ends = declare(session.declare_publisher(progress, reliable=True, express=True))
        condition = keys.robot(robot, "condition")
        self._conditions = declare(session.declare_publisher(condition, reliable=True, express=False))
        if "values" in self._answers:
            # A lost message of values is noticed by its number. An event must arrive.
            values, event = keys.robot(robot, "values"), keys.robot(robot, "event")
            self._values = declare(session.declare_publisher(values, reliable=False, express=False))
            self._events = declare(session.declare_publisher(event, reliable=True, express=False))
        self._gateways.declare()
        self._declare_visible()

    def _declare_visible(self) -> None:
        """Declare, or renew, the presence and the queryables of the robot.

        They are replaced one by one, so that a stop finds no queryable for less than a millisecond.
        """
        for place, declare in enumerate(self._declarations()):
            kept = self._visible.setdefault(place, ExitStack())
            kept.close()
            kept.enter_context(declare())

    def _declarations(self) -> Iterator[Callable[[], AbstractContextManager[object]]]:
        declare, keys, robot = self._session.declare_queryable, self._keys, self._robot
        yield partial(declare, keys.robot(robot, "description"), self._answer_description)
        for kind in self._answers:
            yield partial(declare, keys.robot(robot, kind), partial(self._answer, kind))
        for slow in [kind for kind in self._slow if kind != "description"]:
            yield partial(declare, keys.robot(robot, slow), partial(self._answer_in_thread, slow))
        if self._on_sample is not None:
            # One key for all streams: a subscriber for each would be known to routers only after its first samples.
            hear, sample = self._session.subscribe_payloads, keys.robot(robot, "sample")
            yield partial(hear, sample, MAX_SAMPLE_BYTES, self._on_sample)
        # No one reads this token. Without a declaration on the key, routers search those of all robots for each frame.
        yield partial(self._session.declare_token, keys.robot(robot, "state"))
        # The token comes last, so that a gateway that sees the robot can query it.
        yield partial(self._session.declare_token, keys.presence(robot, self._incarnation))

    def _undeclare(self) -> None:
        for declared in reversed(self._visible.values()):
            declared.close()
        self._gateways.close()
        self._declared.close()

    def _answer_description(self, query: Query) -> None:
        if query.part is not None:
            self._reply(query, self._keys.robot(self._robot, "description"), self._part_of_description(query.part))
        elif len(self._description) <= PART_BYTES:
            self._reply(query, self._keys.robot(self._robot, "description"), self._description)
        else:  # a gateway of an earlier release; a slow link would block the event loop
            self._answer_in_thread("description", query)

    def _part_of_description(self, asked: PartRequest) -> "_Part | _Refusal":
        try:
            return _Part(*part_of(self._description, self._description_tag, asked))
        except PartError as error:
            return _Refusal(str(error))

    def _answer(self, kind: _Prompt, query: Query) -> None:
        payload, answer = query.payload, self._answers[kind]
        if self._tracing is None or kind == "values":
            reply = answer(payload)
        else:
            reply = self._tracing.answer_in_span(kind, self._robot, query.traceparent, payload, answer)
        self._reply(query, self._keys.robot(self._robot, kind), reply)

    def _answer_in_thread(self, kind: _Slow, query: Query) -> None:
        """Answer outside the event loop, because a slow disk, renderer or gateway must not delay the robot."""
        slowly = self._slow[kind]
        if len(slowly.waiting) >= _MOST_WAITING[kind]:
            self._reply(query, self._keys.robot(self._robot, kind), _Refusal(f"too many queries are waiting: {kind}"))
            return
        task = asyncio.get_running_loop().create_task(self._run_in_thread(kind, slowly, query))
        slowly.waiting.add(task)
        task.add_done_callback(slowly.waiting.discard)

    async def _run_in_thread(self, kind: _Slow, slowly: "_ThreadedQueries", query: Query) -> None:
        async with slowly.one:
            await asyncio.to_thread(self._read_and_reply, kind, slowly, query)
        asyncio.get_running_loop().call_later(HELD_S, slowly.replies.forget_idle)

    def _read_and_reply(self, kind: _Slow, slowly: "_ThreadedQueries", query: Query) -> None:
        content: bytes | _Part | _Refusal
        try:
            asked = query.part
            if asked is None:
                content = slowly.read(query.payload)
            else:
                content = _Part(*slowly.replies.part(query.payload, asked, slowly.read))
        except (MeshError, PictureError, PartError) as error:
            _log.info("%s: no %s: %s", self._robot, kind, error)
            content = _Refusal(str(error))
        except Exception as error:  # noqa: BLE001 - a driver may raise whatever its hardware library does
            _log.exception("%s: no %s", self._robot, kind)
            content = _Refusal(f"{type(error).__name__}: {error}"[:512])
        self._reply(query, self._keys.robot(self._robot, kind), content)

    def _reply(self, query: Query, key: str, payload: "bytes | _Part | _Refusal") -> None:
        try:
            if isinstance(payload, _Refusal):
                query.refuse(payload.reason.encode())
            elif isinstance(payload, _Part):
                query.reply(key, payload.payload, payload.head)
            else:
                query.reply(key, payload)
        except TransportError as error:
            _log.warning("%s: a reply on %s could not be sent: %s", self._robot, key, error)

    async def _wait_for_name(self) -> None:
        if not await self._others():
            return
        most_ms = _MOST_LEASES * self._lease_ms
        _log.warning(
            "%s: another agent of this name has a token; waiting at most %d ms for it to expire", self._robot, most_ms
        )
        clock = asyncio.get_running_loop()
        end_s = clock.time() + most_ms / 1000.0
        while others := await self._others():
            if clock.time() >= end_s:
                raise self._duplicate(others[0])
            await asyncio.sleep(self._lease_ms / 1000.0 / _LOOKS_EACH_LEASE)

    async def _others(self) -> list[int]:
        """Return the incarnations of other live agents of this robot, oldest first."""
        keys = await self._session.list_tokens(self._keys.all_presence_of_robot(self._robot), _LOOK_TIMEOUT_S)
        found = [_incarnation(self._keys, key) for key in keys]
        return sorted(incarnation for incarnation in found if incarnation not in (None, self._incarnation))

    def _duplicate(self, incarnation: int) -> DuplicateNameError:
        return DuplicateNameError(
            f"the robot name {self._robot!r} is taken: another agent (run {incarnation}) is alive; "
            "stop it or choose another name"
        )


class AbsentRobot:
    """A robot that its agent cannot use, as a context manager: gateways show it as faulty, with the reason.

    It has presence and answers the query for its description with the reason.
    """

    def __init__(self, session: Session, keys: Keys, robot: str, incarnation: int, reason: str) -> None:
        self.reason = reason
        self._session, self._keys, self._robot, self._incarnation = session, keys, robot, incarnation
        self._declared = ExitStack()

    def __enter__(self) -> Self:
        key, session = self._keys.robot(self._robot, "description"), self._session
        self._declared.enter_context(session.declare_queryable(key, self._refuse))
        self._declared.enter_context(session.declare_token(self._keys.presence(self._robot, self._incarnation)))
        return self

    def __exit__(self, *_: object) -> None:
        self._declared.close()

    def _refuse(self, query: Query) -> None:
        try:
            query.refuse(self.reason.encode())
        except TransportError as error:
            _log.warning("%s: a reply could not be sent: %s", self._robot, error)


class _Refusal(NamedTuple):
    """The reason why a query has no answer."""

    reason: str


class _Part(NamedTuple):
    """A part of a long reply."""

    payload: bytes
    head: PartHead


@dataclass
class _ThreadedQueries:
    """Queries that are answered in threads, one at a time."""

    read: Callable[[bytes], bytes]
    one: asyncio.Lock = field(default_factory=asyncio.Lock)
    replies: LongReplies = field(default_factory=LongReplies)
    waiting: set[asyncio.Task[None]] = field(default_factory=set)


def _incarnation(keys: Keys, key: str) -> int | None:
    """Return the incarnation that a token names; None for a key outside the protocol."""
    try:
        return keys.parse(key).incarnation
    except ValueError:
        return None
