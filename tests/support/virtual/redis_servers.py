"""Redis servers in memory, started, killed and queried like those of ``redis_servers``."""

import contextlib
import shlex

from virtual.client import Connection
from virtual.loop import VirtualLoop
from virtual.redis_server import RedisServer

_ANSWER_S = 2.0


class MemoryServer:
    """Like ``redis_servers.Server``: a killed server keeps its data and can be started again."""

    def __init__(self, loop: VirtualLoop) -> None:
        self._loop, self._server = loop, RedisServer(loop.internet)
        self._runs = True

    @property
    def port(self) -> int:
        return self._server.port

    @property
    def url(self) -> str:
        return self._server.url

    def start(self) -> None:
        if not self._runs:
            self._server.reachable()
        self._runs = True

    def kill(self) -> None:
        self._loop.inside(self._server.unreachable)
        self._runs = False

    def discard(self) -> None:
        """Do nothing: it ends with its loop."""

    def pause(self) -> None:
        self._server.hang()

    def resume(self) -> None:
        self._loop.inside(self._server.release)

    def slow(self, latency_s: float) -> None:
        """Let so much time pass before a command runs."""
        self._server.latency_s = latency_s

    def fail(self, error: str) -> None:
        """Answer all commands with this error; serve again if it is empty."""
        self._server.error = error

    def step_wall(self, by_s: float) -> None:
        self._server.step_wall(by_s)

    def has(self, key: str) -> bool:
        return key in self._server.keys("*")

    def lasting_keys(self, pattern: str) -> list[str]:
        return self._server.keys(pattern, lasting=True)

    def ask(self, *words: object) -> str:
        """Return the first line of the answer, or the text of a long one; empty without a server."""
        said = [str(word).encode() for text in words for word in shlex.split(str(text))]
        try:
            connection = Connection.open(self._loop, "127.0.0.1", self.port, _ANSWER_S)
        except OSError:
            return ""
        with contextlib.closing(connection):
            connection.write(b"*%d\r\n" % len(said) + b"".join(b"$%d\r\n%s\r\n" % (len(word), word) for word in said))
            first, _, rest = connection.read(1_000_000, _ANSWER_S).decode().partition("\r\n")
            return rest.removesuffix("\r\n") if first.startswith("$") else first
