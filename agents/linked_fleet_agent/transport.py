"""The agent's seam towards Zenoh: all that a link needs of a session, in plain Python.

``zenoh_session.py`` implements it. Keys are Zenoh key expressions. Each declaration is a context manager, and is
withdrawn on exit.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol


class TransportError(Exception):
    """The session refused a call, because it is closed or its connections are."""


class Query(Protocol):
    """One question. It ends for the asker with its first reply, or when it is dropped."""

    @property
    def payload(self) -> bytes: ...

    @property
    def traceparent(self) -> bytes | None:
        """The attachment, if it is short enough to be a traceparent."""
        ...

    def reply(self, key: str, payload: bytes) -> None:
        """Answer, from any thread; may block on a full connection. Raises TransportError."""
        ...

    def refuse(self, reason: bytes) -> None:
        """Answer with an error, from any thread. Raises TransportError."""
        ...


class Publisher(Protocol):
    """Publishes on one key."""

    def put(self, payload: bytes) -> None:
        """Publish. Raises TransportError."""
        ...


class Session(Protocol):
    """An open session, which several links may share. Called in the event loop, in which all callbacks are called."""

    def declare_publisher(self, key: str, *, reliable: bool, express: bool) -> AbstractContextManager[Publisher]:
        """A publisher. In congestion a reliable one waits, and another drops. An ``express`` message is not batched."""
        ...

    def declare_queryable(self, key: str, answer: Callable[[Query], None]) -> AbstractContextManager[object]: ...

    def subscribe(self, key: str, hear: Callable[[str], None]) -> AbstractContextManager[object]:
        """Call ``hear`` with the key of each publication."""
        ...

    def subscribe_tokens(self, key: str, hear: Callable[[str, bool], None]) -> AbstractContextManager[object]:
        """Call ``hear`` for each liveliness token that is present now or appears, and for each that goes."""
        ...

    def declare_token(self, key: str) -> AbstractContextManager[object]: ...

    async def list_tokens(self, key: str, timeout_s: float) -> set[str]:
        """The keys of all tokens that become known within ``timeout_s``."""
        ...
