"""Requests that a receiver of callbacks saw, and its answers to them."""

import itertools
import threading
from collections import Counter, defaultdict, deque
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Seen:
    """A request as it arrived; header names in lower case. ``connection``: the port that it came from."""

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
    """Nothing is answered before the receiver is released or closed."""
    stalls_in_body: bool = False
    """The head is sent, and then nothing."""
    hangs_up: bool = False
    """The connection is closed without an answer."""
    endless: bool = False
    """The body goes on for as long as anybody reads."""
    raw: bytes | None = None
    """Sent as it is instead of an answer; then the connection is closed."""


def retry_after(seconds: int, status: int = 503) -> Answer:
    return Answer(status, {"Retry-After": str(seconds)})


def redirect(location: str, status: int = 307) -> Answer:
    return Answer(status, {"Location": location})


def consents(origin: str = "*", rate: str | None = None) -> Answer:
    """To a request for consent (CloudEvents HTTP Web Hooks, 4.2)."""
    return Answer(200, {"WebHook-Allowed-Origin": origin, **({} if rate is None else {"WebHook-Allowed-Rate": rate})})


class Behaviour:
    """A log of requests, and the answers to them.

    Answers 204 to everything but OPTIONS, which it refuses with 405, unless told otherwise. What is scripted for a path
    is used up first, then ``default`` and ``consent`` apply; both may be replaced any time.
    """

    def __init__(self) -> None:
        self.default = Answer()
        self.consent = Answer(405)
        self.endless_bytes = 0
        """The bytes of endless bodies that the client took."""
        self._log: list[Seen] = []
        self._counts: Counter[tuple[str | None, str | None]] = Counter()
        self._scripts: defaultdict[str, deque[Answer]] = defaultdict(deque)
        self._changed = threading.Condition()

    def script(self, *answers: Answer, path: str = "/callback") -> None:
        """The answers to the next requests for this path, whatever their method."""
        with self._changed:
            self._scripts[path].extend(answers)

    def log(self, path: str | None = None, method: str | None = None) -> list[Seen]:
        """Requests in the order of their arrival."""
        with self._changed:
            return [s for s in self._log if path in (None, s.path) and method in (None, s.method)]

    def take(self, seen: Seen) -> Answer:
        """For the server: log a request and choose its answer."""
        with self._changed:
            self._log.append(seen)
            self._counts.update(itertools.product((seen.path, None), (seen.method, None)))
            self._changed.notify_all()
            scripted = self._scripts[seen.path]
            if scripted:
                return scripted.popleft()
            return self.consent if seen.method == "OPTIONS" else self.default
