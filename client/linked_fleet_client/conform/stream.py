"""WebSocket checks: opening, ping, and the first message."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
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


async def open_stream(url: str, accept: str, patience_s: float, credentials: Mapping[str, str]) -> Stream:
    """Open a WebSocket, ping, wait for the first message, and close."""
    parts = urlsplit(url)
    headers = {**credentials, **({"Accept": accept} if accept else {})}
    try:
        async with connect(
            parts._replace(scheme="wss" if parts.scheme == "https" else "ws").geturl(),
            additional_headers=headers,
            proxy=None,
            compression=None,
            open_timeout=patience_s,
            close_timeout=patience_s / 4,
            max_size=MAX_BODY_BYTES,
            # Passed explicitly, so that no redirect leads to another server.
            host=parts.hostname,
            port=parts.port or (443 if parts.scheme == "https" else 80),
        ) as connection:
            ponged, message = await _listen(connection, patience_s / 2)
            return Stream(url, accept, "", ponged, message)
    except (OSError, TimeoutError, WebSocketException, EOFError, ValueError) as error:
        return Stream(url, accept, f"{type(error).__name__}: {error}")


async def _listen(connection: ClientConnection, patience_s: float) -> tuple[bool, bytes | None]:
    """Return if a ping is answered, and the first message if there is one.

    Messages are read meanwhile, because the pong may follow them.
    """
    first: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
    reading = asyncio.create_task(_read(connection, first))
    pong = asyncio.ensure_future(await connection.ping())
    try:
        await asyncio.wait({pong}, timeout=patience_s)
        both: set[asyncio.Future[Any]] = {first, reading}
        await asyncio.wait(both, timeout=patience_s, return_when=asyncio.FIRST_COMPLETED)
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
