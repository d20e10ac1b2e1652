"""Declarations and publications of sessions on the in-memory Zenoh network, for gateways and agents."""

import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from types import TracebackType
from typing import Any, Literal, Self

from linked_fleet_state.events import Payload
from virtual.confined import confined
from virtual.zenoh_connection import Connection, Priority

Kind = Literal["token", "queryable", "subscriber", "token subscriber"]


@lru_cache(65536)
def intersects(one: str, other: str) -> bool:
    """Return True if some key matches both; ``*`` stands for one chunk, ``**`` for any number of chunks."""
    return _intersect(one.split("/"), other.split("/"))


def _intersect(one: list[str], other: list[str]) -> bool:
    if not one or not other:
        return all(chunk == "**" for chunk in one or other)
    if one[0] == "**":
        return _intersect(one[1:], other) or _intersect(one, other[1:])
    if other[0] == "**":
        return _intersect(other, one)
    return (one[0] == other[0] or "*" in (one[0], other[0])) and _intersect(one[1:], other[1:])


@dataclass(eq=False)
class Declaration:
    """Withdrawn on exit. ``take``: the callback, called by its own session."""

    session: "Session"
    kind: Kind
    key: str
    take: Callable[..., None]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.session.withdraw(self)


class Session:
    """The common part of both sides. A session that is not ``alive`` calls nothing back."""

    error: type[Exception]

    def __init__(self, lease_s: float) -> None:
        self._loop = asyncio.get_running_loop()
        self.lease_s, self.alive = lease_s, True
        self.process = confined()
        if self.process is not None:
            self.process.on_kill[self] = self.end
            self.process.on_stop.append(lambda: self._each_connection(Connection.cut))
            self.process.on_go_on.append(lambda: self._each_connection(Connection.heal))
        self.known: dict[Connection, dict[Declaration, None]] = {}
        self._own: dict[Declaration, None] = {}
        self._tokens = Counter[str]()

    def _each_connection(self, act: Callable[[Connection, object], None]) -> None:
        if self.alive:
            for connection in list(self.known):
                act(connection, self)

    def hand_over(self, deliver: Callable[[], None]) -> None:
        """Deliver in the context of the process that owns this session."""
        if self.process is None:
            deliver()
        else:
            self.soon(deliver)

    def soon(self, call: Callable[..., object], *arguments: object) -> None:
        """Call in the next turn of the loop, in the context of the process that owns this session."""
        if self.process is None:
            self._loop.call_soon(call, *arguments)
        else:
            self.process.run(self._loop.call_soon, call, *arguments)

    # -- declarations -------------------------------------------------------------------------------------------------

    def declare(self, kind: Kind, key: str, take: Callable[..., None] = lambda: None) -> Declaration:
        self.check()
        declaration = Declaration(self, kind, key, take)
        self._own[declaration] = None
        for connection in self.known:
            self._announce(connection, declaration)
        if kind == "token":
            self._count(key, 1)
        if kind == "token subscriber":
            for token in self.tokens(key):
                self.soon(self._tell, declaration, token, True)
        return declaration

    def withdraw(self, declaration: Declaration) -> None:
        if self._own.pop(declaration, self) is self:
            return
        for connection in self.known:
            connection.send(self, "control", partial(peer_of(connection, self).forget, connection, declaration))
        if declaration.kind == "token":
            self._count(declaration.key, -1)

    def _announce(self, connection: Connection, declaration: Declaration) -> None:
        connection.send(self, "control", partial(peer_of(connection, self).learn, connection, declaration))

    def learn(self, connection: Connection, declaration: Declaration) -> None:
        self.known[connection][declaration] = None
        if declaration.kind == "token":
            self._count(declaration.key, 1)

    def forget(self, connection: Connection, declaration: Declaration) -> None:
        known = self.known[connection].pop(declaration, self) is not self
        if known and declaration.kind == "token":
            self._count(declaration.key, -1)

    def forget_all(self, connection: Connection) -> None:
        """Forget the peer's declarations."""
        for declaration in list(self.known[connection]):
            self.forget(connection, declaration)

    def announce_all(self, connection: Connection) -> None:
        for declaration in self._own:
            self._announce(connection, declaration)

    def tokens(self, key: str) -> list[str]:
        """Return the keys of all matching tokens of this session and its peers."""
        return [token for token in self._tokens if intersects(token, key)]

    def _count(self, key: str, by: int) -> None:
        """Count declarations of a key: it appears with the first of them, and vanishes with the last."""
        before = self._tokens[key]
        self._tokens[key] += by
        if not self._tokens[key]:
            del self._tokens[key]
        if not before or key not in self._tokens:
            for declaration in self.matching("token subscriber", key):
                self.soon(self._tell, declaration, key, by > 0)

    def _tell(self, declaration: Declaration, *news: object) -> None:
        if self.alive and declaration in self._own:
            declaration.take(*news)

    def matching(self, kind: Kind, key: str) -> list[Declaration]:
        """Return the matching declarations of this session."""
        return [each for each in self._own if each.kind == kind and intersects(each.key, key)]

    def peers(self, kind: Kind, key: str) -> list[Connection]:
        """Return the connections of all peers known to have declared something that matches."""
        return [
            connection
            for connection, known in self.known.items()
            if any(each.kind == kind and intersects(each.key, key) for each in known)
        ]

    # -- publications -------------------------------------------------------------------------------------------------

    def publish(self, key: str, payload: bytes, priority: Priority, droppable: bool) -> None:
        self.check()
        for connection in self.peers("subscriber", key):
            take = partial(peer_of(connection, self).take, key, payload)
            connection.send(self, priority, take, size=len(payload), droppable=droppable, lossy=droppable)

    def take(self, key: str, payload: bytes) -> None:
        for declaration in self.matching("subscriber", key):
            declaration.take(key, payload)

    # -- life ---------------------------------------------------------------------------------------------------------

    def check(self) -> None:
        if not self.alive:
            raise self.error("the session is closed")

    def attached(self, connection: Connection) -> None:
        self.known[connection] = {}
        self.announce_all(connection)

    def detached(self, connection: Connection) -> None:
        for declaration in self.known.pop(connection):
            if declaration.kind == "token":
                self._count(declaration.key, -1)

    def end(self, silently: bool = False) -> None:
        """Nothing is called back from here on; peers hear that the connections are closed, or nothing more."""
        self.alive = False
        for connection in list(self.known):
            if silently:
                connection.fall_silent(self)
            else:
                connection.close(self)

    async def close(self) -> None:
        self.end()


def peer_of(connection: Connection, session: Session) -> Any:
    return connection.peer(session)


def bounded(payload: bytes, limit: int) -> Payload:
    return payload if len(payload) <= limit else len(payload)
