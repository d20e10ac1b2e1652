"""A real HTTP receiver of callbacks on loopback: it logs every request, and behaves as a test says."""

import contextlib
import socket
import ssl
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Protocol

from receiver_behaviour import Answer, Behaviour, Seen, consents, redirect, retry_after
from running import PATIENCE_S
from virtual.loop import current
from virtual.receiver import MemoryReceiver

__all__ = ["Answer", "CallbackReceiver", "Receiver", "Seen", "consents", "receiving", "redirect", "retry_after"]

_CHUNK = b"x" * 65536


class Receiver(Protocol):
    """A receiver of callbacks: ``CallbackReceiver``, or ``virtual.receiver.MemoryReceiver``."""

    default: Answer
    consent: Answer
    endless_bytes: int

    @property
    def port(self) -> int: ...
    @property
    def connections(self) -> int: ...
    def script(self, *answers: Answer, path: str = "/callback") -> None: ...
    def log(self, path: str | None = None, method: str | None = None) -> list[Seen]: ...
    def url(self, path: str = "/callback", host: str = "127.0.0.1") -> str: ...
    def wait(self, count: int, path: str | None = None, method: str | None = None) -> list[Seen]: ...
    def release(self) -> None: ...
    def take(self, seen: Seen) -> Answer: ...
    def close(self) -> None: ...


class CallbackReceiver(Behaviour):
    """A receiver on a socket, with threads."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0, ssl_context: ssl.SSLContext | None = None) -> None:
        super().__init__()
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
        """Number of connections accepted so far."""
        return self._server.accepted

    def url(self, path: str = "/callback", host: str = "127.0.0.1") -> str:
        return f"{self._scheme}://{host}:{self.port}{path}"

    def wait(self, count: int, path: str | None = None, method: str | None = None) -> list[Seen]:
        """Wait until the log has so many entries, and return it."""
        with self._changed:
            arrived = self._changed.wait_for(lambda: self._counts[path, method] >= count, PATIENCE_S)
            assert arrived, f"{self._counts[path, method]} of {count} requests arrived"
            return self.log(path, method)

    def release(self) -> None:
        """Send the delayed responses, and delay no more."""
        self._released.set()

    def close(self) -> None:
        self.release()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def stall(self) -> None:
        """Wait until released; for the server."""
        self._released.wait(PATIENCE_S)


@contextlib.contextmanager
def receiving(host: str = "127.0.0.1", port: int = 0, ssl_context: ssl.SSLContext | None = None) -> Iterator[Receiver]:
    """Run a receiver: in memory on virtual time unless it uses TLS."""
    loop = current()
    if loop is not None and ssl_context is None:
        with contextlib.closing(MemoryReceiver(loop, host, port)) as in_memory:
            yield in_memory
        return
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
        """Log nothing; the receiver has a log of its own."""


class _Server(ThreadingHTTPServer):
    """A server that ends its handlers when it ends, even if a client keeps a connection open."""

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
        """Handle in the connection's own thread, so that a slow TLS handshake delays no other."""
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
        """Ignore errors: many tests make clients disconnect, and other faults show as a missing response."""
