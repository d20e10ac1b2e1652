"""Gateways' sessions on the in-memory Zenoh network."""

import asyncio
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

from linked_fleet_link.transport import Answer, Question, TransportError
from linked_fleet_state.events import Payload
from virtual.zenoh_connection import Connection
from virtual.zenoh_sessions import Session, bounded, peer_of

T = TypeVar("T")
_HAND_OVER_S = 1e-4
"""Time from the arrival of a message until it is handled."""


@dataclass(eq=False)
class _Asked:
    """A pending question; ``pending``: the connections on which an answer may still come."""

    question: Question
    hear: Callable[[Answer | None], None]
    pending: set[Connection] = field(default_factory=set)
    timer: asyncio.TimerHandle | None = None


class GatewaySession(Session):
    """Implements ``linked_fleet_link.transport.Session``."""

    error = TransportError

    def __init__(self, lease_s: float, connects: bool) -> None:
        super().__init__(lease_s)
        self._connects = connects
        self._asked: dict[_Asked, None] = {}

    @property
    def connected(self) -> bool:
        return not self._connects or bool(self.known)

    async def subscribe_frames(self, key: str, limit: int, hear: Callable[[str, Payload], None]) -> None:
        await self.subscribe(key, limit, hear)

    async def subscribe(self, key: str, limit: int, hear: Callable[[str, Payload], None]) -> None:
        self.declare("subscriber", key, lambda key, payload: hear(key, bounded(payload, limit)))

    async def subscribe_tokens(self, key: str, hear: Callable[[str, bool], None]) -> None:
        self.declare("token subscriber", key, hear)

    async def declare_token(self, key: str) -> None:
        self.declare("token", key)

    async def list_tokens(self, key: str, timeout_s: float, read: Callable[[Iterable[str]], T]) -> tuple[T, bool]:
        """List tokens. With a router, this includes all tokens declared before, not only those already received."""
        settled_s = [connection.settled_s(self) for connection in self.known if self._connects]
        await asyncio.sleep(min(timeout_s, max(settled_s, default=0.0) - self._loop.time() + _HAND_OVER_S))
        return read(self.tokens(key)), True

    async def redeclare(self) -> None:
        for declaration in [each for each in self._own if each.kind in ("subscriber", "token")]:
            self.withdraw(declaration)
            self.declare(declaration.kind, declaration.key, declaration.take)

    def declare_heartbeat(self, key: str) -> Callable[[], None]:
        return lambda: self.publish(key, b"", "heartbeat", droppable=True)

    def put_newest(self, key: str, payload: bytes) -> None:
        self.publish(key, payload, "newest", droppable=True)

    async def ask(self, question: Question, hear: Callable[[Answer | None], None]) -> float:
        self.check()
        asked = _Asked(question, hear, set(connections := self.peers("queryable", question.key)))
        self._asked[asked] = None
        asked.timer = self._loop.call_later(question.timeout_s, self._expire, asked)
        for connection in connections:
            query = partial(peer_of(connection, self).query, connection, question, partial(self._answer, asked))
            size, droppable = len(question.payload or b""), not question.blocking
            connection.send(self, question.priority, query, size=size, droppable=droppable)
        if not asked.pending:
            self.soon(self._over, asked)
        return 0.0

    async def keep_route(self, key: str) -> None:
        """Do nothing: routes are free here."""

    def look_up(self, connection: Connection, key: str, listed: "asyncio.Future[list[str]]") -> None:
        """Answer an agent with the tokens that this gateway sees."""
        tokens = self.tokens(key)
        connection.send(self, "control", lambda: None if listed.done() else listed.set_result(tokens))

    def _answer(self, asked: _Asked, connection: Connection, answer: Answer | None) -> None:
        if asked not in self._asked:
            return
        if answer is not None:
            asked.hear(answer)
            return
        asked.pending.discard(connection)
        if not asked.pending:
            self._over(asked)

    def _expire(self, asked: _Asked) -> None:
        asked.hear(Answer(None, asked.question.key))
        self._over(asked)

    def _over(self, asked: _Asked) -> None:
        if self._asked.pop(asked, self) is not self and asked.timer is not None:
            asked.timer.cancel()
            asked.hear(None)

    def detached(self, connection: Connection) -> None:
        super().detached(connection)
        for asked in list(self._asked):
            if connection in asked.pending:
                self.soon(self._answer, asked, connection, None)

    def end(self, silently: bool = False) -> None:
        for asked in self._asked:
            if asked.timer is not None:
                asked.timer.cancel()
        self._asked.clear()
        super().end(silently)
