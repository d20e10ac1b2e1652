"""One run of an action, as the method that carries it out sees it."""

import threading
from typing import Generic, Protocol, TypeVar

import msgspec

from linked_fleet_agent.components.input_stream import InputStream

F = TypeVar("F")


class CancelledActionError(Exception):
    """The action was cancelled: by a client, a stop, a newer motion, or the loss of the last gateway."""


class EndUnknownError(Exception):
    """The action was told to end, and whether it has is not known; the message says why. It fails with that reason."""


class Report(Protocol):
    """Takes what an action says while it runs; may be called from any thread."""

    def __call__(self, progress: float | None, reason: str, feedback: bytes | None) -> None: ...


class Call(Generic[F]):
    """One run of an action; ``F`` is the type of its feedback, None if it has none.

    A method that runs in a thread must honour its cancellation: it waits by ``sleep``, or looks at ``cancelled``.
    One that is ``async`` is cancelled as any task of asyncio is.
    """

    def __init__(self, id: str, report: Report, stream: InputStream | None = None) -> None:
        self.id = id
        """The id of the invocation."""
        self.stream = stream
        """The further inputs of this run, if it was opened as a stream."""
        self._report, self._ended = report, threading.Event()
        self._progress: float | None = None
        self.replaced = False
        """True once the action is cancelled because a newer run of it ``takes_over``."""
        self.goes_on = False
        """True once a run that resumes is cancelled because its agent ends: what it has begun is to go on."""

    @property
    def cancelled(self) -> bool:
        return self._ended.is_set()

    def check(self) -> None:
        """Raise CancelledActionError if the action is cancelled."""
        if self._ended.is_set():
            raise CancelledActionError

    def sleep(self, seconds: float) -> None:
        """Wait in a thread. Raises CancelledActionError as soon as the action is cancelled."""
        if self._ended.wait(seconds):
            raise CancelledActionError

    def progress(self, share: float, reason: str = "") -> None:
        """Report the completed share, 0 to 1, and in words what is being done."""
        self._report(min(max(share, 0.0), 1.0), reason[:1024], None)

    def feedback(self, value: F) -> None:
        """Publish feedback of the declared type; ten times a second at most, the newest wins."""
        self._report(None, "", msgspec.json.encode(value))

    def cancel(self, replaced: bool = False) -> None:
        """Ask the method to end. For the agent."""
        self.replaced = replaced
        self._ended.set()
