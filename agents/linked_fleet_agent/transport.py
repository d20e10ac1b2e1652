"""The interface to Zenoh that an agent's link needs, in plain Python.

``zenoh_session.py`` implements it. Keys are Zenoh key expressions. Each declaration is a context manager that
undeclares on exit.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from linked_fleet_agent.wire.parts import PartHead, PartRequest


class TransportError(Exception):
    """The session refused a call because it or its connections are closed."""


class Query(Protocol):
    """One query. It ends for its sender with the first reply, or when it is dropped."""

    @property
    def payload(self) -> bytes: ...

    @property
    def traceparent(self) -> bytes | None:
        """The attachment, if it is short enough for a traceparent."""
        ...

    @property
    def part(self) -> PartRequest | None:
        """The part of the reply that the attachment asks for; None if the query asks for the whole reply."""
        ...

    def reply(self, key: str, payload: bytes, head: PartHead | None = None) -> None:
        """Reply, from any thread; ``head`` if the payload is a part. Raises TransportError.

        May block on a congested connection, unless the query was sent without blocking: then the reply is dropped.
        """
        ...

    def refuse(self, reason: bytes) -> None:
        """Reply with an error, from any thread. Raises TransportError."""
        ...


class Publisher(Protocol):
    """Publishes on one key."""

    def put(self, payload: bytes) -> None:
        """Publish. Raises TransportError."""
        ...


class Session(Protocol):
    """An open session that several links may share. Used on the event loop, which also runs all callbacks."""

    def declare_publisher(self, key: str, *, reliable: bool, express: bool) -> AbstractContextManager[Publisher]:
        """Declare a publisher.

        Under congestion a reliable one waits, another drops. ``express`` messages are not batched.
        """
        ...

    def declare_queryable(self, key: str, answer: Callable[[Query], None]) -> AbstractContextManager[object]: ...

    def subscribe(self, key: str, hear: Callable[[str], None]) -> AbstractContextManager[object]:
        """Call ``hear`` with the key of each publication."""
        ...

    def subscribe_payloads(self, key: str, limit: int, hear: Callable[[bytes], None]) -> AbstractContextManager[object]:
        """Call ``hear`` with the payload of each publication; one above ``limit`` bytes is dropped."""
        ...

    def subscribe_tokens(self, key: str, hear: Callable[[str, bool], None]) -> AbstractContextManager[object]:
        """Call ``hear`` for each liveliness token that is present now or appears, and for each that disappears."""
        ...

    def declare_token(self, key: str) -> AbstractContextManager[object]: ...

    async def list_tokens(self, key: str, timeout_s: float) -> set[str]:
        """Return the keys of all tokens that become known within ``timeout_s``."""
        ...
