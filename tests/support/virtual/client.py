"""HTTP and WebSocket clients of a test on virtual time: each call runs the event loop until its response is there."""

import asyncio
import contextlib
import io
import socket
import ssl
import struct
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any
from unittest import mock

import httpcore
from websockets.client import ClientProtocol
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode
from websockets.http11 import Response
from websockets.protocol import State
from websockets.typing import Subprotocol
from websockets.uri import parse_uri

from virtual.loop import VirtualLoop
from virtual.tcp import MemoryTransport

PATIENCE_S = 15.0
DELAY_S = 0.005
"""Before a client begins to send, so that time passes between two requests as on a real network."""


class Connection(asyncio.Protocol):
    """One end of a connection, read and written synchronously. Data is only received while the client reads."""

    def __init__(self, loop: VirtualLoop) -> None:
        self._loop = loop
        self._arrived = bytearray()
        self._speaking = False
        self.ended = False
        self.error: Exception | None = None

    @classmethod
    def open(cls, loop: VirtualLoop, host: str, port: int, timeout_s: float, **more: Any) -> "Connection":
        """Connect. Raises OSError, and TimeoutError after ``timeout_s``."""
        _, connection = loop.run(loop.internet.connect(lambda: cls(loop), host, port, **more), timeout_s)
        assert isinstance(connection, Connection)
        return connection

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, MemoryTransport)
        self.transport = transport
        transport.pause_reading()

    def data_received(self, data: bytes) -> None:
        self._arrived += data

    def eof_received(self) -> bool:
        self.ended = True
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        self.ended, self.error = True, exc

    def read(self, most: int, timeout_s: float) -> bytes:
        """Return what has arrived; empty at the end. Raises TimeoutError, ConnectionResetError."""
        self._speaking = False
        if not self._arrived and not self.ended:
            self.transport.resume_reading()
            try:
                self._loop.run_until(lambda: self._arrived or self.ended, "bytes of the server", timeout_s)
            except AssertionError as error:
                raise TimeoutError(str(error)) from error
            finally:
                self.transport.pause_reading()
        if not self._arrived and self.error is not None:
            raise self.error
        piece = bytes(self._arrived[:most])
        del self._arrived[: len(piece)]
        return piece

    def write(self, data: bytes) -> None:
        if not self._speaking:
            self._loop.run_for(DELAY_S)
            self._speaking = True
        if self.transport.is_closing():
            raise self.error or BrokenPipeError(32, "the connection is closed")
        self.transport.write(data)

    def close(self) -> None:
        self.transport.close()


class _Stream(httpcore.NetworkStream):
    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def read(self, max_bytes: int, timeout: float | None = None) -> bytes:
        try:
            return self._connection.read(max_bytes, PATIENCE_S if timeout is None else timeout)
        except TimeoutError as error:
            raise httpcore.ReadTimeout(str(error)) from error
        except OSError as error:
            raise httpcore.ReadError(str(error)) from error

    def write(self, buffer: bytes, timeout: float | None = None) -> None:
        try:
            self._connection.write(buffer)
        except OSError as error:
            raise httpcore.WriteError(str(error)) from error

    def close(self) -> None:
        self._connection.close()

    def start_tls(self, ssl_context: ssl.SSLContext, *_: Any, **__: Any) -> httpcore.NetworkStream:
        raise NotImplementedError("TLS is tested with real sockets")

    def get_extra_info(self, info: str) -> Any:
        transport = self._connection.transport
        if info == "is_readable":  # an idle connection that is readable has been closed
            return transport.readable() or self._connection.ended
        return transport.get_extra_info({"client_addr": "sockname", "server_addr": "peername"}.get(info, info))


def connect_tcp(
    loop: VirtualLoop, host: str, port: int, timeout: float | None = None, local_address: str | None = None
) -> httpcore.NetworkStream:
    """Like ``httpcore.SyncBackend.connect_tcp``."""
    try:
        within_s = PATIENCE_S if timeout is None else timeout
        return _Stream(Connection.open(loop, host, port, within_s, source=local_address or "127.0.0.1"))
    except TimeoutError as error:
        raise httpcore.ConnectTimeout(str(error)) from error
    except OSError as error:
        raise httpcore.ConnectError(str(error)) from error


class MemorySocket:
    """A blocking ``socket.socket`` with an in-memory connection."""

    def __init__(self, connection: Connection, timeout_s: float | None) -> None:
        self._connection, self._timeout_s = connection, timeout_s
        self._lingers = True

    def settimeout(self, timeout_s: float | None) -> None:
        self._timeout_s = timeout_s

    def gettimeout(self) -> float | None:
        return self._timeout_s

    def recv(self, most: int) -> bytes:
        return self._connection.read(most, PATIENCE_S if self._timeout_s is None else self._timeout_s)

    def sendall(self, data: bytes) -> None:
        self._connection.write(bytes(data))

    def send(self, data: bytes) -> int:
        self.sendall(data)
        return len(data)

    def makefile(self, mode: str = "r", buffering: int = -1, **_: object) -> Any:
        return io.BufferedRWPair(_File(self), _File(self)) if "w" in mode else io.BufferedReader(_File(self))

    def shutdown(self, how: int) -> None:
        if how != socket.SHUT_RD:
            self._connection.transport.write_eof()

    def setsockopt(self, level: int, option: int, value: Any) -> None:
        """Ignore all options but SO_LINGER: with a time of 0 ``close`` resets the connection."""
        if (level, option) == (socket.SOL_SOCKET, socket.SO_LINGER):
            self._lingers = struct.unpack("ii", value) != (1, 0)

    def getsockname(self) -> Any:
        return self._connection.transport.get_extra_info("sockname")

    def getpeername(self) -> Any:
        return self._connection.transport.get_extra_info("peername")

    def close(self) -> None:
        if self._lingers:
            self._connection.close()
        else:
            self._connection.transport.abort()

    def __enter__(self) -> "MemorySocket":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _File(io.RawIOBase):
    def __init__(self, of: MemorySocket) -> None:
        self._of = of

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        piece = self._of.recv(len(buffer))
        buffer[: len(piece)] = piece
        return len(piece)

    def write(self, data: Any) -> int:
        return self._of.send(bytes(data))


def dial(
    loop: VirtualLoop, address: tuple[str, int], timeout: float | None = None, receive_bytes: int = 64 * 1024
) -> MemorySocket:
    """Like ``socket.create_connection``."""
    within_s = timeout if isinstance(timeout, float | int) else PATIENCE_S
    connection = Connection.open(loop, *address, within_s, receive_bytes=receive_bytes)
    return MemorySocket(connection, timeout if isinstance(timeout, float | int) else None)


@contextlib.contextmanager
def clients_in_memory(loop: VirtualLoop) -> Iterator[None]:
    """Make synchronous clients of httpx, and ``socket.create_connection``, connect in memory."""

    def connect(_: object, host: str, port: int, timeout: float | None = None, local_address: str | None = None,
                socket_options: object = None) -> httpcore.NetworkStream:  # fmt: skip
        return connect_tcp(loop, host, port, timeout, local_address)

    def create(address: tuple[str, int], timeout: float | None = None, *_: object, **__: object) -> MemorySocket:
        return dial(loop, address, timeout)

    with (
        mock.patch.object(httpcore.SyncBackend, "connect_tcp", connect),
        mock.patch.object(socket, "create_connection", create),
    ):
        yield


class WebSocket:
    """A WebSocket like that of ``websockets.sync.client``. Raises InvalidStatus if the handshake is refused."""

    def __init__(
        self,
        loop: VirtualLoop,
        url: str,
        fields: dict[str, str] | None = None,
        subprotocol: str | None = None,
        receive_bytes: int = 64 * 1024,
    ) -> None:
        uri = parse_uri(url)
        subprotocols = None if subprotocol is None else [Subprotocol(each) for each in subprotocol.split(", ")]
        self._protocol = ClientProtocol(uri, subprotocols=subprotocols, max_size=None)
        self._connection = Connection.open(loop, uri.host, uri.port, PATIENCE_S, receive_bytes=receive_bytes)
        request = self._protocol.connect()
        for name, value in (fields or {}).items():
            request.headers[name] = value
        self._protocol.send_request(request)
        self._frames: list[Frame] = []
        self._response: Response | None = None
        self._send()
        self._pump(lambda: self._protocol.state is not State.CONNECTING, PATIENCE_S)
        if self._protocol.handshake_exc is not None:
            self._connection.close()
            raise self._protocol.handshake_exc

    @property
    def response(self) -> Response:
        assert self._response is not None
        return self._response

    @property
    def close_reason(self) -> tuple[int, str] | None:
        """Code and reason of the server's close frame, if it has come."""
        said = self._protocol.close_rcvd
        return None if said is None else (said.code, said.reason)

    @property
    def subprotocol(self) -> str | None:
        return self._protocol.subprotocol

    def recv(self, timeout: float = PATIENCE_S) -> bytes | str:
        """Return one message. Raises TimeoutError, and ConnectionClosed at the end."""
        self._pump(lambda: self._whole() or self._protocol.state is State.CLOSED, timeout)
        if not self._whole():
            raise self._protocol.close_exc
        first = self._frames.pop(0)
        content = bytes(first.data)
        while not first.fin:
            first = self._frames.pop(0)
            content += bytes(first.data)
        return content.decode() if first.opcode is Opcode.TEXT else content

    def send(self, message: str | bytes) -> None:
        if isinstance(message, str):
            self._protocol.send_text(message.encode())
        else:
            self._protocol.send_binary(message)
        self._send()

    def ping(self, content: bytes = b"") -> None:
        self._protocol.send_ping(content)
        self._send()

    def close(self) -> None:
        if self._protocol.state is State.OPEN:
            self._protocol.send_close(1000)
            # after a reset the other end does not learn of the close
            with contextlib.suppress(OSError, ConnectionClosed):
                self._send()
                self._pump(lambda: self._protocol.state is State.CLOSED, PATIENCE_S)
        self._connection.close()

    def __enter__(self) -> "WebSocket":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _whole(self) -> bool:
        return any(frame.fin for frame in self._frames)

    def _pump(self, condition: Callable[[], bool], timeout_s: float) -> None:
        """Read and respond until the condition holds."""
        while not condition():
            try:
                piece = self._connection.read(65_536, timeout_s)
            except ConnectionResetError:
                piece = b""
            if piece:
                self._protocol.receive_data(piece)
            else:
                self._protocol.receive_eof()
            with contextlib.suppress(OSError):  # what was received before the reset is still delivered
                self._send()
            data = (Opcode.TEXT, Opcode.BINARY, Opcode.CONT)
            events = self._protocol.events_received()
            self._response = next((each for each in events if isinstance(each, Response)), self._response)
            self._frames += [each for each in events if isinstance(each, Frame) and each.opcode in data]
            if not piece:
                return

    def _send(self) -> None:
        for piece in self._protocol.data_to_send():
            if piece:
                self._connection.write(piece)
            elif not self._connection.transport.is_closing():
                self._connection.transport.write_eof()
