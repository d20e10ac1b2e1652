"""HTTP versions and message framing that are refused before a request is dispatched (RFC 9112)."""

from http import HTTPStatus
from typing import Any

import h11


class RefusedRequest(h11.RemoteProtocolError):
    """A request that gets ``error_status_hint`` and the text of this error; then the connection closes."""


class ServerConnection(h11.Connection):
    """An ``h11.Connection`` that raises RefusedRequest instead of returning a request that cannot be served."""

    method = b""
    """The method of the latest request, refused or not."""

    def next_event(self) -> Any:
        event = super().next_event()
        if isinstance(event, h11.Request):
            self.method = event.method
            _check(event)
        return event


def _check(request: h11.Request) -> None:
    """Raises RefusedRequest for another major version (RFC 9110, 15.6.6) and ambiguous framing (RFC 9112, 6.1)."""
    if not request.http_version.startswith(b"1."):
        raise RefusedRequest("The major version of HTTP served here is 1.", HTTPStatus.HTTP_VERSION_NOT_SUPPORTED)
    names = {name for name, _ in request.headers}
    if b"transfer-encoding" not in names:
        return
    # A proxy in front may have framed the body by the other field: what follows could be a smuggled request.
    if b"content-length" in names:
        raise RefusedRequest("A request has Content-Length or Transfer-Encoding, not both.", HTTPStatus.BAD_REQUEST)
    if request.http_version == b"1.0":
        raise RefusedRequest("HTTP/1.0 has no Transfer-Encoding.", HTTPStatus.BAD_REQUEST)
