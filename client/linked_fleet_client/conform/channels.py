"""Channels of trial subscriptions: a WebSocket, and a receiver of callbacks.

The opening of a WebSocket, its ping and its first message are checked. The receiver accepts POST on one secret path and
consents to requests for permission.
"""

import asyncio
import contextlib
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from linked_fleet_client.conform.web import MAX_BODY_BYTES


@dataclass(frozen=True)
class Stream:
    """The result of opening a WebSocket. ``fault`` is the reason of a failure; ``accept`` the requested media type."""

    url: str
    accept: str = ""
    fault: str = ""
    ponged: bool = False
    message: bytes | None = None


async def open_stream(url: str, accept: str, timeout_s: float, credentials: Mapping[str, str]) -> Stream:
    """Open a WebSocket, ping, wait for the first message, and close."""
    parts = urlsplit(url)
    headers = {**credentials, **({"Accept": accept} if accept else {})}
    try:
        async with connect(
            parts._replace(scheme="wss" if parts.scheme == "https" else "ws").geturl(),
            additional_headers=headers,
            proxy=None,
            compression=None,
            open_timeout=timeout_s,
            close_timeout=timeout_s / 4,
            max_size=MAX_BODY_BYTES,
            # Passed explicitly, so that no redirect leads to another server.
            host=parts.hostname,
            port=parts.port or (443 if parts.scheme == "https" else 80),
        ) as connection:
            ponged, message = await _listen(connection, timeout_s / 2)
            return Stream(url, accept, "", ponged, message)
    except (OSError, TimeoutError, WebSocketException, EOFError, ValueError) as error:
        return Stream(url, accept, f"{type(error).__name__}: {error}")


async def _listen(connection: ClientConnection, timeout_s: float) -> tuple[bool, bytes | None]:
    """Return True if a ping is answered, with the first message or None.

    Messages are read meanwhile, because the pong may follow them.
    """
    first: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
    reading = asyncio.create_task(_read(connection, first))
    pong = asyncio.ensure_future(await connection.ping())
    try:
        await asyncio.wait({pong}, timeout=timeout_s)
        both: set[asyncio.Future[Any]] = {first, reading}
        await asyncio.wait(both, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        answered = pong.done() and not pong.cancelled() and pong.exception() is None
        return answered, first.result() if first.done() else None
    finally:
        pong.cancel()
        reading.cancel()
        await asyncio.gather(pong, reading, return_exceptions=True)


async def _read(connection: ClientConnection, first: asyncio.Future[bytes]) -> None:
    async for message in connection:
        if not first.done():
            first.set_result(message.encode() if isinstance(message, str) else message)


_MAX_BYTES = 4 * 2**20
_TIMEOUT_S = 30.0
_CONSENT = b"HTTP/1.1 200 OK\r\nWebHook-Allowed-Origin: *\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
_TAKEN = b"HTTP/1.1 204 No Content\r\nConnection: close\r\n\r\n"
_UNKNOWN = b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


@dataclass(frozen=True)
class Delivery:
    """A received callback; ``media_type`` is without parameters, in lower case."""

    media_type: str
    body: bytes


@dataclass
class Mailbox:
    """One callback URL and the first delivery to it."""

    url: str
    token: str
    first: asyncio.Future[Delivery] = field(repr=False)

    async def wait_for_delivery(self, timeout_s: float) -> Delivery | None:
        with contextlib.suppress(TimeoutError):
            return await asyncio.wait_for(asyncio.shield(self.first), timeout_s)
        return None


class Receiver:
    """An HTTP server for callbacks, with one mailbox for each subscription."""

    def __init__(self, host: str) -> None:
        self._host = host
        self._port = 0
        self._server: asyncio.Server | None = None
        self._boxes: dict[str, Mailbox] = {}

    def mailbox(self) -> Mailbox:
        token = secrets.token_hex(12)
        host = f"[{self._host}]" if ":" in self._host else self._host
        url = f"http://{host}:{self._port}/{token}"
        self._boxes[token] = Mailbox(url, token, asyncio.get_running_loop().create_future())
        return self._boxes[token]

    async def start(self) -> None:
        """Start listening. Raises OSError if the host is not an address of this machine."""
        self._server = await asyncio.start_server(self._serve, self._host, 0, limit=65536)
        self._port = self._server.sockets[0].getsockname()[1]

    def close(self) -> None:
        if self._server is not None:
            self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one request; close the connection on malformed input."""
        try:
            async with asyncio.timeout(_TIMEOUT_S):
                writer.write(await self._answer(reader))
                await writer.drain()
        except (TimeoutError, OSError, ValueError, EOFError, asyncio.LimitOverrunError):
            return
        finally:
            writer.close()

    async def _answer(self, reader: asyncio.StreamReader) -> bytes:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
        request, *lines = head.split("\r\n")
        headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        method, path, _ = request.split(" ", 2)
        box = self._boxes.get(path.removeprefix("/"))
        if box is None:
            return _UNKNOWN
        if method == "OPTIONS":
            return _CONSENT
        delivery = Delivery(
            headers.get("content-type", "").partition(";")[0].strip().lower(), await _body(reader, headers)
        )
        if method == "POST" and not box.first.done():
            box.first.set_result(delivery)
        return _TAKEN


async def _body(reader: asyncio.StreamReader, headers: dict[str, str]) -> bytes:
    if "chunked" not in headers.get("transfer-encoding", "").lower():
        return await reader.readexactly(_allowed(int(headers.get("content-length", "0"))))
    body = b""
    while size := int((await reader.readuntil(b"\r\n")).split(b";")[0], 16):
        body += await reader.readexactly(_allowed(size, len(body)))
        await reader.readexactly(2)
    return body


def _allowed(size: int, before: int = 0) -> int:
    if not 0 <= size <= _MAX_BYTES - before:
        raise ValueError(f"a delivery of more than {_MAX_BYTES} bytes")
    return size
