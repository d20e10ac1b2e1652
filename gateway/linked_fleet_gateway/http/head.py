"""The bytes of a response head: status line and header fields (RFC 9112, 4 and 5)."""

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
