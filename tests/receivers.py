"""A real HTTP receiver of callbacks on loopback: it logs every request, and behaves as a test tells it to."""

import contextlib
import itertools
import socket
import ssl
import threading
from collections import Counter, defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from running import PATIENCE_S

_CHUNK = b"x" * 65536


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


class CallbackReceiver:
    """Answers 204 to everything but OPTIONS, which it refuses with 405, unless told otherwise.

    What is scripted for a path is used up first, then ``default`` and ``consent`` apply; both may be replaced any time.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0, ssl_context: ssl.SSLContext | None = None) -> None:
        self.default = Answer()
        self.consent = Answer(405)
        self.endless_bytes = 0
        """Of endless bodies, as far as they were taken."""
        self._log: list[Seen] = []
        self._counts: Counter[tuple[str | None, str | None]] = Counter()
        self._scripts: defaultdict[str, deque[Answer]] = defaultdict(deque)
        self._changed = threading.Condition()
        self._released = threading.Event()
        self._server = _Server(self, host, port, ssl_context)
        self._scheme = "https" if ssl_context else "http"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.01})
        self._thread.start()

    @property
    def port(self) -> int:
        return int(self._server.server_address[1])

    @property
    def connections(self) -> int:
        """How many were made so far."""
        return self._server.accepted

    def url(self, path: str = "/callback", host: str = "127.0.0.1") -> str:
        return f"{self._scheme}://{host}:{self.port}{path}"

    def script(self, *answers: Answer, path: str = "/callback") -> None:
        """The answers to the next requests for this path, whatever their method."""
        with self._changed:
            self._scripts[path].extend(answers)

    def log(self, path: str | None = None, method: str | None = None) -> list[Seen]:
        """Requests in the order of their arrival."""
        with self._changed:
            return [s for s in self._log if path in (None, s.path) and method in (None, s.method)]

    def wait(self, count: int, path: str | None = None, method: str | None = None) -> list[Seen]:
        """The log once it has so many entries."""
        with self._changed:
            arrived = self._changed.wait_for(lambda: self._counts[path, method] >= count, PATIENCE_S)
            assert arrived, f"{self._counts[path, method]} of {count} requests arrived"
            return self.log(path, method)

    def release(self) -> None:
        """Let stalled answers go, and stall no more."""
        self._released.set()

    def close(self) -> None:
        self.release()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

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

    def stall(self) -> None:
        """For the server."""
        self._released.wait(PATIENCE_S)


@contextlib.contextmanager
def receiving(
    host: str = "127.0.0.1", port: int = 0, ssl_context: ssl.SSLContext | None = None
) -> Iterator[CallbackReceiver]:
    with contextlib.closing(CallbackReceiver(host, port, ssl_context)) as receiver:
        yield receiver


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    wbufsize = -1  # head and body leave in one segment
    server: "_Server"

    def answer(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        headers = {name.lower(): value for name, value in self.headers.items()}
        receiver = self.server.receiver
        answer = receiver.take(Seen(self.command, self.path, headers, body, self.client_address[1]))
        if answer.stalls:
            receiver.stall()
        self.close_connection = self.close_connection or answer.hangs_up or answer.raw is not None
        if answer.raw is not None:
            self.wfile.write(answer.raw)
        elif not answer.hangs_up:
            self._send(answer, receiver)

    do_POST = do_OPTIONS = do_GET = do_PUT = answer  # noqa: N815  (names that http.server looks for)

    def _send(self, answer: Answer, receiver: CallbackReceiver) -> None:
        self.send_response(answer.status)
        for name, value in answer.headers.items():
            self.send_header(name, value)
        if answer.endless or answer.stalls_in_body:
            self.close_connection = True
        elif answer.status != 204:
            self.send_header("Content-Length", str(len(answer.body)))
        self.end_headers()
        self.wfile.write(answer.body)
        self.wfile.flush()
        if answer.stalls_in_body:
            receiver.stall()
        while answer.endless:
            self.wfile.write(_CHUNK)
            receiver.endless_bytes += len(_CHUNK)

    def log_message(self, format: str, *args: Any) -> None:
        """The log is ours."""


class _Server(ThreadingHTTPServer):
    """Its handlers end with it, also those whose client holds a connection open."""

    daemon_threads = False
    request_queue_size = 512

    def __init__(
        self, receiver: CallbackReceiver, host: str, port: int, ssl_context: ssl.SSLContext | None = None
    ) -> None:
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.receiver = receiver
        self.accepted = 0
        self._ssl_context = ssl_context
        self._open: set[socket.socket] = set()
        self._guard = threading.Lock()
        super().__init__((host, port), _Handler)

    def get_request(self) -> tuple[socket.socket, Any]:
        connection, client = super().get_request()
        with self._guard:
            self.accepted += 1
            self._open.add(connection)
        return connection, client

    def finish_request(self, request: Any, client_address: Any) -> None:
        """In the connection's own thread, so that a slow TLS handshake holds up no other."""
        if self._ssl_context is None:
            super().finish_request(request, client_address)
            return
        with self._ssl_context.wrap_socket(request.dup(), server_side=True) as secured:
            super().finish_request(secured, client_address)

    def shutdown_request(self, request: Any) -> None:
        with self._guard:
            self._open.discard(request)
        super().shutdown_request(request)

    def server_close(self) -> None:
        with self._guard:
            for connection in self._open:
                with contextlib.suppress(OSError):  # the client may have gone already
                    connection.shutdown(socket.SHUT_RDWR)
        super().server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Clients that go away are what many tests are about; other faults show as a missing answer."""
