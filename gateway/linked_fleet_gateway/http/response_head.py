"""The bytes of response heads: status line and header fields (RFC 9112, 4 and 5), and whole responses of the server."""

from collections.abc import Iterable, Sequence
from http import HTTPStatus

Fields = Sequence[tuple[bytes, bytes]]
_STATUS_LINES = {each.value: b"HTTP/1.1 %d %b\r\n" % (each.value, each.phrase.encode("ascii")) for each in HTTPStatus}


def status_line(status: int) -> bytes:
    """Return the status line with its line end."""
    return _STATUS_LINES.get(status) or b"HTTP/1.1 %d \r\n" % status


def block(fields: Iterable[tuple[bytes, bytes]]) -> bytes:
    """Return the lines of fields.

    RuntimeError for a line end inside one, which would begin another field or response.
    """
    lines = [name + b": " + value for name, value in fields]
    lines.append(b"")
    found = b"\r\n".join(lines)
    ends = len(lines) - 1
    if found.count(b"\n") != ends or found.count(b"\r") != ends or b"\0" in found:
        raise RuntimeError("A header field has a line end inside.")
    return found


NO_PLACE = b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 1\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"
"""The response on a connection beyond the limit of connections."""


def refusal(status: HTTPStatus, text: str, *, has_content: bool = True) -> bytes:
    """Return the response to a request that no application sees; the connection is closed after it."""
    fields = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", b"%d" % len(text.encode())),
        (b"connection", b"close"),
    ]
    return status_line(status) + block(fields) + b"\r\n" + (text.encode() if has_content else b"")
