"""Raw requests that HTTP libraries do not send or show."""

import asyncio
import ssl
from urllib.parse import urlsplit

_MAX_BYTES = 2**20


async def exchange(url: str, request: bytes, patience_s: float) -> tuple[bytes, str]:
    """Return the received bytes (at most 1 MiB) until the server closes or time is over, and the error if there is one.

    ``{host}`` and ``{path}`` in ``request`` are replaced by those of the URL.
    """
    parts = urlsplit(url)
    path = parts.path or "/"
    request = request.replace(b"{host}", parts.netloc.encode()).replace(b"{path}", path.encode())
    received = bytearray()
    try:
        async with asyncio.timeout(patience_s):
            await _talk(url, request, received)
    except TimeoutError:
        return bytes(received), f"the connection was still open after {patience_s:g} s"
    except (OSError, ValueError) as error:
        return bytes(received), f"{type(error).__name__}: {error}"
    return bytes(received), ""


async def _talk(url: str, request: bytes, received: bytearray) -> None:
    parts = urlsplit(url)
    secured = ssl.create_default_context() if parts.scheme == "https" else None
    reader, writer = await asyncio.open_connection(parts.hostname, parts.port or (443 if secured else 80), ssl=secured)
    try:
        writer.write(request)
        await writer.drain()
        while len(received) < _MAX_BYTES and (part := await reader.read(65536)):
            received += part
    finally:
        writer.close()


def status(answer: bytes) -> int:
    """Return the code in the status line; 0 if there is none."""
    line = answer.partition(b"\r\n")[0].split(b" ")
    if len(line) < 2 or not line[0].startswith(b"HTTP/1.") or not line[1].isdigit():
        return 0
    return int(line[1][:3])
