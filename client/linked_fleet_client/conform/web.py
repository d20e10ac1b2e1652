"""Requests to one server only, and raw requests that HTTP libraries do not send or show.

Each request is bounded in time, bytes and redirects.
"""

import asyncio
import ssl
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self
from urllib.parse import urldefrag, urljoin, urlsplit

import httpx

MAX_BODY_BYTES = 16 * 2**20
_MAX_REDIRECTS = 5
_MAX_URL_LENGTH = 2000
_PORTS = {"http": 80, "https": 443}
_REDIRECTS = frozenset({301, 302, 303, 307, 308})
_SAFE = frozenset({"GET", "HEAD", "OPTIONS"})


class OutOfTimeError(Exception):
    """The total time is over; what was not checked by then is undecided."""


@dataclass(frozen=True)
class Answer:
    """The answer to one request. If ``fault`` is set, there is no usable answer and ``status`` may be 0."""

    method: str
    url: str
    status: int = 0
    headers: httpx.Headers = field(default_factory=httpx.Headers)
    body: bytes = b""
    version: str = ""
    fault: str = ""
    unreached: bool = False
    closed: bool = False
    """The server closed the connection without a complete answer."""

    @property
    def successful(self) -> bool:
        return not self.fault and 200 <= self.status < 300

    @property
    def media_type(self) -> str:
        return self.header("content-type").partition(";")[0].strip().lower()

    @property
    def allow(self) -> frozenset[str]:
        return frozenset(name.strip() for name in self.header("allow").split(",") if name.strip())

    def header(self, name: str) -> str:
        """Return the field's values joined by commas; empty if absent."""
        return str(self.headers.get(name, ""))

    def __str__(self) -> str:
        return f"{self.method} {self.url}: {self.fault or self.status}"


class Web:
    """The client of one origin, for at most ``limit_s`` seconds, with ``timeout_s`` for each request.

    ``received`` counts body bytes. ``token`` (RFC 6750) is sent to this origin only.
    """

    def __init__(self, root: str, timeout_s: float, limit_s: float, token: str = "") -> None:
        self.root = urldefrag(root).url
        self.origin = _origin(self.root)
        if self.origin is None:
            raise ValueError(f"not an http or https URL: {root}")
        self.timeout_s = timeout_s
        self.received = 0
        self._started = time.monotonic()
        self._limit_s = limit_s
        # Proxies and credentials of the environment are ignored, so that only the server is tested.
        self.credentials = {"authorization": f"Bearer {token}"} if token else {}
        headers = {"accept-encoding": "identity", **self.credentials}
        self._client = httpx.AsyncClient(timeout=timeout_s, trust_env=False, headers=headers)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._client.aclose()

    @property
    def used_share(self) -> float:
        """The used share of the total time, from 0."""
        return (time.monotonic() - self._started) / self._limit_s

    def same_origin(self, url: str) -> bool:
        """Return True if a URL belongs to the origin of the server."""
        return len(url) <= _MAX_URL_LENGTH and _origin(url) == self.origin

    @property
    def left_s(self) -> float:
        return max(0.0, (1 - self.used_share) * self._limit_s)

    def check_time(self) -> None:
        if self.used_share >= 1:
            raise OutOfTimeError(f"not tried within the total limit of {self._limit_s:g} s")

    async def request(
        self,
        method: str,
        url: str,
        headers: Mapping[str, str] | None = None,
        body: bytes | None = None,
        in_any_case: bool = False,
    ) -> Answer:
        """Send a request, following redirects of safe methods within the origin.

        ``in_any_case`` ignores the total limit.
        """
        for _ in range(_MAX_REDIRECTS + 1):
            if not in_any_case:
                self.check_time()
            answer = await self._once(method, url, headers or {}, body)
            if answer.closed and method in _SAFE:  # a server may close an idle connection (RFC 9112, 9.3.1)
                answer = await self._once(method, url, headers or {}, body)
            target = absolute(url, answer.header("location"))
            if answer.fault or answer.status not in _REDIRECTS or method not in _SAFE or not self.same_origin(target):
                return answer
            url = target
        return Answer(method, url, answer.status, fault=f"more than {_MAX_REDIRECTS} redirects")

    async def _once(self, method: str, url: str, headers: Mapping[str, str], body: bytes | None) -> Answer:
        if not self.same_origin(url):
            return Answer(method, url, fault="not of the server's origin, left alone")
        try:
            async with (
                asyncio.timeout(self.timeout_s),
                self._client.stream(method, url, headers=dict(headers), content=body) as response,
            ):
                content, fault = await _bounded(response)
                self.received += len(content)
                version = response.http_version
                return Answer(method, url, response.status_code, response.headers, content, version, fault)
        except TimeoutError:
            return Answer(method, url, fault=f"no complete answer within {self.timeout_s:g} s")
        except (httpx.ConnectError, httpx.ConnectTimeout) as error:
            return Answer(method, url, fault=f"no connection: {error}", unreached=True)
        except (httpx.RemoteProtocolError, httpx.ReadError, httpx.WriteError) as error:
            return Answer(method, url, fault=f"no valid answer: {type(error).__name__} {error}", closed=True)
        except (httpx.HTTPError, httpx.InvalidURL, httpx.StreamError, ValueError, OSError) as error:
            return Answer(method, url, fault=f"no valid answer: {type(error).__name__} {error}")


async def _bounded(response: httpx.Response) -> tuple[bytes, str]:
    """Return the body, and an error or an empty string."""
    if response.headers.get("content-encoding", "identity") != "identity":
        return b"", "the body is encoded although only identity was accepted"
    parts, size = [], 0
    async for part in response.aiter_raw():
        size += len(part)
        if size > MAX_BODY_BYTES:
            return b"", f"the body is larger than {MAX_BODY_BYTES} bytes"
        parts.append(part)
    return b"".join(parts), ""


def _origin(url: str) -> tuple[str, str, int] | None:
    """Return scheme, host and port; None if it is not a plain http(s) URL."""
    try:
        parts = urlsplit(url)
        port = parts.port or _PORTS.get(parts.scheme, 0)
    except ValueError:
        return None
    if parts.scheme not in _PORTS or not parts.hostname or "@" in parts.netloc:
        return None
    return parts.scheme, parts.hostname, port


def _joined(base: str, reference: str) -> str:
    try:
        return urljoin(base, reference)
    except ValueError:
        return ""


def absolute(base: str, reference: str) -> str:
    """Return a reference in a header field as an absolute URL; empty if it is invalid."""
    return urldefrag(_joined(base, reference)).url if reference else ""


_MAX_BYTES = 2**20


async def exchange(url: str, request: bytes, timeout_s: float) -> tuple[bytes, str]:
    """Return the received bytes (at most 1 MiB) until the server closes or time is over, and the error if there is one.

    ``{host}`` and ``{path}`` in ``request`` are replaced by those of the URL.
    """
    parts = urlsplit(url)
    path = parts.path or "/"
    request = request.replace(b"{host}", parts.netloc.encode()).replace(b"{path}", path.encode())
    received = bytearray()
    try:
        async with asyncio.timeout(timeout_s):
            await _talk(url, request, received)
    except TimeoutError:
        return bytes(received), f"the connection was still open after {timeout_s:g} s"
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
