"""A session of the in-memory Zenoh network, with the part of ``zenoh.Session`` that tests use to play robots."""

from collections.abc import Callable
from typing import Any

from linked_fleet_agent.transport import Query
from virtual.loop import VirtualLoop
from virtual.zenoh_agent import AgentSession
from virtual.zenoh_sessions import Declaration


class _Payload(bytes):
    def to_bytes(self) -> bytes:  # type: ignore[override]
        return bytes(self)


class PlayedQuery:
    """Like ``zenoh.Query``."""

    def __init__(self, query: Query) -> None:
        self._query = query
        self.payload = _Payload(query.payload)

    def reply(self, key: str, payload: bytes) -> None:
        self._query.reply(str(key), payload)

    def reply_err(self, payload: bytes) -> None:
        self._query.refuse(payload)

    def __enter__(self) -> "PlayedQuery":
        return self

    def __exit__(self, *_: object) -> None:
        """Do nothing: a query ends with its reply, or when it is garbage-collected."""


class _Declared:
    def __init__(self, declaration: Declaration) -> None:
        self._declaration = declaration

    def undeclare(self) -> None:
        self._declaration.__exit__(None, None, None)


class _Publisher:
    def __init__(self, session: AgentSession, key: str) -> None:
        self._publisher = session.declare_publisher(key, reliable=True, express=True)

    def put(self, payload: bytes) -> None:
        self._publisher.put(payload)

    def undeclare(self) -> None:
        self._publisher.__exit__()


class PlayedSession:
    """Like ``zenoh.Session``, opened at once."""

    def __init__(self, loop: VirtualLoop, session: AgentSession) -> None:
        self._loop, self._session = loop, session

    def declare_queryable(self, key: str, answer: Callable[[Any], None], **_: object) -> _Declared:
        declare, take = self._session.declare_queryable, lambda query: answer(PlayedQuery(query))
        return _Declared(self._loop.inside(declare, str(key), take))

    def declare_publisher(self, key: str, **_: object) -> _Publisher:
        return _Publisher(self._session, str(key))

    def put(self, key: str, payload: bytes, **_: object) -> None:
        self._loop.inside(self.declare_publisher(key).put, payload)

    def liveliness(self) -> "PlayedSession":
        return self

    def declare_token(self, key: str) -> _Declared:
        return _Declared(self._loop.inside(self._session.declare_token, str(key)))

    def is_closed(self) -> bool:
        return not self._session.alive

    def close(self) -> None:
        self._loop.inside(self._session.end)
