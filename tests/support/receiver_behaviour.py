"""Requests that a receiver of callbacks got, and its responses to them."""

import itertools
import threading
from collections import Counter, defaultdict, deque
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Seen:
    """A request as it arrived; header names in lower case. ``connection``: the client's port."""

    method: str
    path: str
    headers: dict[str, str]
    body: bytes
    connection: int


@dataclass(frozen=True)
class Answer:
    status: int = 204
    headers: dict[str, str] = field(default_factory=dict)
    body: bytes = b""
    stalls: bool = False
    """Send nothing until the receiver is released or closed."""
    stalls_in_body: bool = False
    """Send the head, and then nothing."""
    hangs_up: bool = False
    """Close the connection without a response."""
    endless: bool = False
    """Send a body without an end."""
    raw: bytes | None = None
    """Bytes to send instead of a response; then the connection is closed."""


def retry_after(seconds: int, status: int = 503) -> Answer:
    return Answer(status, {"Retry-After": str(seconds)})


def redirect(location: str, status: int = 307) -> Answer:
    return Answer(status, {"Location": location})


def consents(origin: str = "*", rate: str | None = None) -> Answer:
    """Return the response to a consent request (CloudEvents HTTP Web Hooks, 4.2)."""
    return Answer(200, {"WebHook-Allowed-Origin": origin, **({} if rate is None else {"WebHook-Allowed-Rate": rate})})


class Behaviour:
    """A log of requests, and the responses to them.

    Unless told otherwise, responds with 204, and with 405 to OPTIONS. The script of a path is used first, then
    ``default`` and ``consent`` apply; both may be replaced at any time.
    """

    def __init__(self) -> None:
        self.default = Answer()
        self.consent = Answer(405)
        self.endless_bytes = 0
        """Number of bytes of endless bodies that the client accepted."""
        self._log: list[Seen] = []
        self._counts: Counter[tuple[str | None, str | None]] = Counter()
        self._scripts: defaultdict[str, deque[Answer]] = defaultdict(deque)
        self._changed = threading.Condition()

    def script(self, *answers: Answer, path: str = "/callback") -> None:
        """Set the responses to the next requests for this path, of any method."""
        with self._changed:
            self._scripts[path].extend(answers)

    def log(self, path: str | None = None, method: str | None = None) -> list[Seen]:
        """Return the requests in the order of their arrival."""
        with self._changed:
            return [s for s in self._log if path in (None, s.path) and method in (None, s.method)]

    def take(self, seen: Seen) -> Answer:
        """Log a request and choose its response; for the server."""
        with self._changed:
            self._log.append(seen)
            self._counts.update(itertools.product((seen.path, None), (seen.method, None)))
            self._changed.notify_all()
            scripted = self._scripts[seen.path]
            if scripted:
                return scripted.popleft()
            return self.consent if seen.method == "OPTIONS" else self.default
