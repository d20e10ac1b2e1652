"""The gateway's seam towards Zenoh: all that the link needs of a session, in plain Python.

``gateway/linked_fleet_link/zenoh_session.py`` implements it. Keys are Zenoh key expressions.
"""

import asyncio
from collections.abc import Callable, Iterable, Mapping
from typing import Literal, NamedTuple, Protocol, TypeVar

from linked_fleet_agent.wire.parts import PartHead, PartRequest
from linked_fleet_state.events import Payload

_T = TypeVar("_T")

Priority = Literal["real time", "data", "background"]


class LinkError(Exception):
    """The session cannot be opened: a port in use or an invalid endpoint. One line for people."""


class TransportError(Exception):
    """The session refused a call because it or its connections are closed."""


MAX_ERROR_BYTES = 1024


def readable_error(payload: bytes) -> str:
    """Return the sentence of an error reply: text without control characters, empty if it is too long or no text."""
    text = payload.decode(errors="replace") if len(payload) <= MAX_ERROR_BYTES else ""
    return "".join(character if character.isprintable() else " " for character in text).strip()


class Answer(NamedTuple):
    """One reply to a query; ``payload`` is None for an error reply, whose sentence is ``error``.

    ``head`` is that of a part.
    """

    payload: Payload | None
    key: str
    head: PartHead | None = None
    error: str = ""


class Question(NamedTuple):
    """A query to every queryable whose key matches.

    Replies have the ``priority`` of the query. For a reply above ``limit`` bytes only its size is passed on. A query
    that is not ``blocking`` is dropped under congestion and then not answered; so are its replies. The attachment is
    ``part``, or else ``traceparent``.
    """

    key: str
    payload: bytes | None
    timeout_s: float
    limit: int
    priority: Priority = "data"
    blocking: bool = True
    traceparent: bytes | None = None
    part: PartRequest | None = None


class Session(Protocol):
    """An open session. Its methods are called on the event loop."""

    @property
    def connected(self) -> bool:
        """True if robots can be heard. False for a session that connects to routers and is connected to none."""
        ...

    async def subscribe_frames(self, key: str, limit: int, hear: Callable[[str, Payload], None]) -> None:
        """Call ``hear``, in a single thread, with key and payload of each publication. Frames may arrive in batches."""
        ...

    async def subscribe(self, key: str, limit: int, hear: Callable[[str, Payload], None]) -> None:
        """Call ``hear``, in any thread, with key and payload of each publication."""
        ...

    async def subscribe_tokens(self, key: str, hear: Callable[[str, bool], None]) -> None:
        """Call ``hear``, in any thread, for each token that is present now or appears, and for each that goes."""
        ...

    async def declare_token(self, key: str) -> None:
        """Declare a liveliness token for the life of the session."""
        ...

    async def list_tokens(self, key: str, timeout_s: float, read: Callable[[Iterable[str]], _T]) -> tuple[_T, bool]:
        """Return ``read`` of the keys of all tokens, called in a thread if possible, and True if the list is
        complete.
        """
        ...

    async def redeclare(self) -> None:
        """Undeclare and declare again the subscriptions and tokens of this session, in order.

        This informs routers that have lost such a declaration.
        """
        ...

    def declare_heartbeat(self, key: str) -> Callable[[], None]:
        """Return a function that publishes an empty message without blocking and drops it under congestion.

        Only heartbeats have this priority, so no other message delays them. The function raises TransportError.
        """
        ...

    def put_newest(self, key: str, payload: bytes) -> None:
        """Publish what a newer message replaces: without blocking, and dropped under congestion.

        Only such messages have this priority. Raises TransportError.
        """
        ...

    async def ask(self, question: Question, hear: Callable[[Answer | None], None]) -> float:
        """Send a query and return the processor time that this took, in seconds.

        ``hear`` is called on the event loop with each reply, and with None at the end, after ``timeout_s`` at the
        latest.
        """
        ...

    async def keep_route(self, key: str) -> None:
        """Cache the route of a key, which otherwise is searched among the keys of all robots each time."""
        ...

    async def close(self) -> None:
        """Undeclare everything and close; may be called again. Raises TransportError."""
        ...


class Opener(Protocol):
    """Opens a session that listens on and connects to endpoints; ``trust`` is Zenoh's TLS and access configuration.

    Raises LinkError.
    """

    async def __call__(
        self, listen: tuple[str, ...], connect: tuple[str, ...], trust: Mapping[str, object]
    ) -> Session: ...


MAX_REPLIES = 8  # to one query: a robot and, briefly, the previous run of its agent
MAX_STOP_REPLIES = 10_000  # to one query to all robots


async def ask(
    session: Session,
    question: Question,
    judge: Callable[[bytes | str, str], _T | None],
    sent: Callable[[float], None] = lambda processor_s: None,
) -> _T | None:
    """Send a query and return the first result of ``judge`` that is not None; None if there are no more replies.

    ``judge`` gets a payload, or a sentence why there is none, and the key of the reply. ``sent`` gets the processor
    time in seconds for sending. Raises TimeoutError after the query's ``timeout_s``.
    """
    return await ask_for_answer(
        session, question, lambda answer: judge(payload_or_reason(answer, question.limit), answer.key), sent
    )


async def ask_for_answer(
    session: Session,
    question: Question,
    judge: Callable[[Answer], _T | None],
    sent: Callable[[float], None] = lambda processor_s: None,
) -> _T | None:
    """Do what ``ask`` does with a ``judge`` of answers."""
    left = MAX_STOP_REPLIES if question.priority == "real time" else MAX_REPLIES
    result: asyncio.Future[_T | None] = asyncio.get_running_loop().create_future()

    def hear(answer: Answer | None) -> None:
        nonlocal left
        if result.done():
            return
        if answer is None:
            result.set_result(None)
            return
        left -= 1
        if left < 0:  # further replies cannot be genuine
            return
        try:
            judged = judge(answer)
        except Exception as error:  # noqa: BLE001 - whoever asks gets it
            result.set_exception(error)
        else:
            if judged is not None:
                result.set_result(judged)

    async with asyncio.timeout(question.timeout_s):
        sent(await session.ask(question, hear))
        return await result


def payload_or_reason(answer: Answer, limit: int) -> bytes | str:
    """Return the payload, or a sentence why there is none."""
    if answer.payload is None:
        return answer.error or "the agent answered with an error"
    if isinstance(answer.payload, int):
        return f"the answer has {answer.payload} bytes; {limit} are the most"
    return answer.payload
