"""HTTP clients and WebSockets for tests: over sockets, or in memory on virtual time."""

import functools
import ssl
from collections.abc import Mapping
from types import TracebackType
from typing import Protocol, Self

import httpx
from websockets.http11 import Response
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from virtual.client import WebSocket as VirtualWebSocket
from virtual.loop import current

PATIENCE_S = 15.0


class WebSocket(Protocol):
    """The part of ``websockets.sync.client.ClientConnection`` that tests use."""

    @property
    def response(self) -> Response | None: ...
    @property
    def subprotocol(self) -> str | None: ...
    def recv(self, timeout: float | None = None) -> bytes | str: ...
    def send(self, message: str | bytes) -> None: ...
    def close(self) -> None: ...
    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


@functools.cache
def trusted() -> ssl.SSLContext:
    """Return a shared TLS context with the system's root certificates; reading them takes 50 ms."""
    return ssl.create_default_context()


def http_client(*, timeout: float = 20.0, **options: object) -> httpx.Client:
    return httpx.Client(timeout=timeout, verify=trusted(), **options)  # type: ignore[arg-type]


def websocket(url: str, fields: Mapping[str, str | None], subprotocol: str | None = None) -> WebSocket:
    """Open a WebSocket at an ``http`` URL. Raises InvalidStatus if that is refused."""
    url, given = "ws" + url.removeprefix("http"), {name: value for name, value in fields.items() if value is not None}
    loop = current()
    if loop is not None:
        return VirtualWebSocket(loop, url, given, subprotocol)
    return connect(  # type: ignore[return-value]
        url, additional_headers=given, subprotocols=None if subprotocol is None else [Subprotocol(subprotocol)],
        compression=None, proxy=None, max_size=None, open_timeout=PATIENCE_S,
    )  # fmt: skip
