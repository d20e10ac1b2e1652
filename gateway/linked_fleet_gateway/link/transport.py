"""The gateway's seam towards Zenoh: all that the link needs of a session, in plain Python.

``gateway/linked_fleet_gateway/link/zenoh_session.py`` implements it. Keys are Zenoh key expressions.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Literal, NamedTuple, Protocol, TypeVar

from linked_fleet_gateway.fleet.inbox import Payload

_T = TypeVar("_T")

Priority = Literal["real time", "data", "background"]


class LinkError(Exception):
    """The session cannot be opened: a port that is taken or an endpoint that means nothing. One line for a human."""


class TransportError(Exception):
    """The session refused a call, because it is closed or its connections are."""


class Answer(NamedTuple):
    """One reply to a question; ``payload`` is None for an error reply."""

    payload: Payload | None
    key: str


class Question(NamedTuple):
    """A question to every queryable whose key matches.

    Answers have the ``priority`` of the question. Of an answer above ``limit`` bytes only the size is told. A question
    that is not ``patient`` is given up where a connection is full, and is then not answered. ``traceparent`` is the
    attachment.
    """

    key: str
    payload: bytes | None
    timeout_s: float
    limit: int
    priority: Priority = "data"
    patient: bool = True
    traceparent: bytes | None = None


class Session(Protocol):
    """An open session. Its methods are called in the event loop."""

    @property
    def connected(self) -> bool:
        """Robots can be heard: false for a session that connects to routers, and is connected to none."""
        ...

    async def subscribe_frames(self, key: str, limit: int, hear: Callable[[str, Payload], None]) -> None:
        """Call ``hear``, in any one thread, with key and payload of each publication. Frames may come in batches."""
        ...

    async def subscribe(self, key: str, limit: int, hear: Callable[[str, Payload], None]) -> None:
        """Call ``hear``, in any thread, with key and payload of each publication."""
        ...

    async def subscribe_tokens(self, key: str, hear: Callable[[str, bool], None]) -> None:
        """Call ``hear``, in any thread, for each token that is present now or appears, and for each that goes."""
        ...

    async def declare_token(self, key: str) -> None:
        """Declare a liveliness token, which lasts as long as the session."""
        ...

    async def list_tokens(self, key: str, timeout_s: float, read: Callable[[Iterable[str]], _T]) -> tuple[_T, bool]:
        """``read`` applied to the keys of all tokens, in a thread if there are threads, and whether these are all."""
        ...

    async def declare_anew(self) -> None:
        """Withdraw subscriptions to publications and tokens of this session, and declare them again, in their order.

        Routers that have lost such a declaration are told of it again.
        """
        ...

    def declare_heartbeat(self, key: str) -> Callable[[], None]:
        """A function that publishes an empty message, drops it in congestion, never blocks; raises TransportError.

        No other publication has the priority of heartbeats: none delays them.
        """
        ...

    async def ask(self, question: Question, hear: Callable[[Answer | None], None]) -> float:
        """Send a question, and return how many seconds of processor time that took.

        ``hear`` is called in the event loop with each answer, and with None at the end, at ``timeout_s`` at the latest.
        """
        ...

    async def keep_route(self, key: str) -> None:
        """Have the route of a key kept, which otherwise is looked for among the keys of all robots each time."""
        ...

    async def close(self) -> None:
        """Withdraw all that was declared; do nothing if that is done. Raises TransportError."""
        ...


class Opener(Protocol):
    """Opens a session that listens on and connects to endpoints; ``trust`` is Zenoh's configuration of proofs.

    Raises LinkError.
    """

    async def __call__(
        self, listen: tuple[str, ...], connect: tuple[str, ...], trust: Mapping[str, object]
    ) -> Session: ...
