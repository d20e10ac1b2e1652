"""Agents' sessions on the in-memory Zenoh network."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Self

from linked_fleet_agent.transport import Query, TransportError
from linked_fleet_agent.wire import parts
from linked_fleet_agent.wire.traceparent import MAX_BYTES
from linked_fleet_link.transport import Answer, Question, readable_error
from virtual.zenoh_connection import Connection
from virtual.zenoh_sessions import Declaration, Session, bounded, intersects, peer_of


class _Query:
    """Implements ``linked_fleet_agent.transport.Query``. ``tell`` sends answers, and None at the end."""

    def __init__(self, session: "AgentSession", question: Question, tell: Callable[[Answer | None], None]) -> None:
        self._session, self._loop, self._question = session, asyncio.get_running_loop(), question
        self._tell: Callable[[Answer | None], None] | None = tell

    @property
    def payload(self) -> bytes:
        return self._question.payload or b""

    @property
    def traceparent(self) -> bytes | None:
        attached = self._question.traceparent
        return None if attached is None or len(attached) > MAX_BYTES else attached

    @property
    def part(self) -> parts.PartRequest | None:
        return self._question.part

    def reply(self, key: str, payload: bytes, head: parts.PartHead | None = None) -> None:
        if not intersects(key, self._question.key):
            raise TransportError(f"{key} does not answer a question on {self._question.key}")
        self._end(Answer(bounded(payload, self._question.limit), key, head))

    def refuse(self, reason: bytes) -> None:
        self._end(Answer(None, self._question.key, error=readable_error(reason)))

    def _end(self, *answers: Answer) -> None:
        tell, self._tell = self._tell, None
        if tell is None or not self._session.alive:
            raise TransportError("the question is over")
        for answer in (*answers, None):
            self._loop.call_soon_threadsafe(tell, answer)

    def __del__(self) -> None:
        if self._tell is not None and self._session.alive and not self._loop.is_closed():
            self._end()


class _Publisher:
    """Implements ``linked_fleet_agent.transport.Publisher``."""

    def __init__(self, session: "AgentSession", key: str, reliable: bool) -> None:
        self._session, self._key, self._reliable = session, key, reliable
        self._declared = True

    def put(self, payload: bytes) -> None:
        if not self._declared:
            raise TransportError("the publisher is undeclared")
        self._session.publish(self._key, payload, "data", droppable=not self._reliable)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._declared = False


class AgentSession(Session):
    """Implements ``linked_fleet_agent.transport.Session``. ``met`` is set once it is connected to a gateway."""

    error = TransportError

    def __init__(self, lease_s: float) -> None:
        super().__init__(lease_s)
        self.met = asyncio.Event()
        self._lists: dict[Connection, list[asyncio.Future[list[str]]]] = {}

    def declare_publisher(self, key: str, *, reliable: bool, express: bool) -> _Publisher:
        self.check()
        return _Publisher(self, key, reliable)

    def declare_queryable(self, key: str, answer: Callable[[Query], None]) -> Declaration:
        return self.declare("queryable", key, answer)

    def subscribe(self, key: str, hear: Callable[[str], None]) -> Declaration:
        return self.declare("subscriber", key, lambda key, payload: hear(key))

    def subscribe_payloads(self, key: str, limit: int, hear: Callable[[bytes], None]) -> Declaration:
        return self.declare("subscriber", key, lambda key, payload: hear(payload) if len(payload) <= limit else None)

    def subscribe_tokens(self, key: str, hear: Callable[[str, bool], None]) -> Declaration:
        return self.declare("token subscriber", key, hear)

    def declare_token(self, key: str) -> Declaration:
        return self.declare("token", key)

    async def list_tokens(self, key: str, timeout_s: float) -> set[str]:
        """List tokens through all connected gateways, by which agents see each other."""
        self.check()
        lists = [self._list(connection, key) for connection in self.known]
        if lists:
            await asyncio.wait(lists, timeout=timeout_s)
        own = {each.key for each in self._own if each.kind == "token" and intersects(each.key, key)}
        return own.union(*(each.result() for each in lists if each.done()))

    def _list(self, connection: Connection, key: str) -> "asyncio.Future[list[str]]":
        listed: asyncio.Future[list[str]] = self._loop.create_future()
        self._lists.setdefault(connection, []).append(listed)
        connection.send(self, "control", partial(peer_of(connection, self).look_up, connection, key, listed))
        return listed

    def attached(self, connection: Connection) -> None:
        super().attached(connection)
        self.met.set()

    def detached(self, connection: Connection) -> None:
        super().detached(connection)
        for listed in self._lists.pop(connection, ()):
            if not listed.done():
                listed.set_result([])

    def query(
        self, connection: Connection, question: Question, answer: Callable[[Connection, Answer | None], None]
    ) -> None:
        """Handle an incoming question, which ends once each queryable has answered or dropped it."""
        asked = self.matching("queryable", question.key)
        pending = set(asked)

        def tell(declaration: Declaration, said: Answer | None) -> None:
            if said is None:
                pending.discard(declaration)
            if said is not None or not pending:
                payload = None if said is None else said.payload
                size = len(payload) if isinstance(payload, bytes) else payload or 0
                connection.send(
                    self, question.priority, partial(answer, connection, said), size=size,
                    droppable=said is not None and not question.blocking,
                )  # fmt: skip

        for declaration in asked:
            declaration.take(_Query(self, question, partial(tell, declaration)))
        if not asked:
            connection.send(self, question.priority, partial(answer, connection, None))
