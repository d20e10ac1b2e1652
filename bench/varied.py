"""Requests as different clients send them: each for a random resource, with fields in random order and values."""

import contextlib
import http.client
import random
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple
from urllib.parse import urlsplit

_AGENTS = ("curl/8.14", "python-httpx/0.28.1", "Mozilla/5.0 (X11; Linux x86_64; rv:140.0) Gecko/20100101 Firefox/140.0")
_ACCEPTED = ("*/*", "text/turtle", "application/ld+json", "text/turtle, application/ld+json;q=0.9, */*;q=0.1")
ENCODINGS = "gzip, deflate, br, zstd"
_LANGUAGES = ("en-US,en;q=0.5", "de", "*")


class Target(NamedTuple):
    """A resource, and a function that returns one of its bodies, in Turtle."""

    path: str
    body: Callable[[random.Random], str]


class Client:
    """A connection of one client.

    ``prefer``: its Prefer field, if any. ``seed`` makes its requests repeatable. ``accepted``: values of its Accept
    field, of which each request has one; ``encodings``: that of Accept-Encoding.
    """

    def __init__(
        self,
        url: str,
        seed: int = 1,
        prefer: str = "",
        accepted: Sequence[str] = _ACCEPTED,
        encodings: str = ENCODINGS,
    ) -> None:
        self._prefer, self._accepted, self._encodings = prefer, accepted, encodings
        self._connection = http.client.HTTPConnection(urlsplit(url).netloc)
        self._random = random.Random(seed)  # noqa: S311

    def ask(self, method: str, path: str, content: bytes = b"", media_type: str = "") -> tuple[int, bytes]:
        """Send a request; return the status and the content of its response."""
        connection = self._connection
        connection.putrequest(method, path, skip_accept_encoding=True)
        for name, value in self._fields(len(content), media_type):
            connection.putheader(name, value)
        connection.endheaders(content or None)
        answer = connection.getresponse()
        return answer.status, answer.read()

    def post(self, targets: Sequence[Target]) -> tuple[int, bytes]:
        target = self._random.choice(targets)
        content = target.body(self._random).encode()
        return self.ask("POST", target.path, content, "text/turtle" if content else "")

    def close(self) -> None:
        self._connection.close()

    def _fields(self, size: int, media_type: str) -> Sequence[tuple[str, str]]:
        chance = self._random
        trace = f"00-{chance.getrandbits(128):032x}-{chance.getrandbits(64):016x}-01"
        fields = [
            ("User-Agent", chance.choice(_AGENTS)), ("Accept", chance.choice(self._accepted)), ("Traceparent", trace),
            ("Accept-Language", chance.choice(_LANGUAGES)), ("Accept-Encoding", self._encodings),
            ("Content-Length", str(size)),
        ]  # fmt: skip
        fields += [(name, value) for name, value in (("Content-Type", media_type), ("Prefer", self._prefer)) if value]
        chance.shuffle(fields)
        return fields


def timed_ms(url: str, targets: Sequence[Target], status: int, seconds: float, prefer: str = "") -> list[float]:
    """Send POSTs to random targets on one connection, each after the response to the one before."""
    took, end = list[float](), time.monotonic() + seconds
    with contextlib.closing(Client(url, prefer=prefer)) as client:
        while time.monotonic() < end:
            begin = time.perf_counter()
            answered, said = client.post(targets)
            took.append((time.perf_counter() - begin) * 1e3)
            assert answered == status, said
    return took


def for_ever(url: str, paths: Sequence[str], seed: int) -> Iterator[None]:
    """Read random resources on one connection, one with each step."""
    chance = random.Random(seed)  # noqa: S311
    with contextlib.closing(Client(url, seed)) as client:
        while True:
            client.ask("GET", chance.choice(paths))
            yield
