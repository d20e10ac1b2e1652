"""Request lines, adapted to a parser that does not know all methods, targets and versions of HTTP/1."""

import re
from http import HTTPStatus
from typing import NamedTuple

_REQUEST_LINE = re.compile(rb"([!#$%&'*+\-.^_`|~0-9A-Za-z]+) ([\x21-\x7e]+) HTTP/([0-9])\.([0-9])\r?\n")
_METHODS = frozenset({b"GET", b"HEAD", b"OPTIONS", b"POST", b"PUT", b"PATCH", b"DELETE"})
_ANY_METHOD = b"PUT"
"""Replaces a method that the parser does not know or treats specially, such as CONNECT."""


class RequestLineError(Exception):
    """A request line that is refused before parsing, with status and reason."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class RequestLine(NamedTuple):
    """``data``: bytes for the parser. ``method``, ``target``: those of the request where ``data`` differs."""

    data: bytes
    method: bytes = b""
    target: bytes = b""


def is_plain(data: bytes) -> bool:
    """Return True if the parser can get the bytes unchanged."""
    match = _REQUEST_LINE.match(data)
    if match is None:
        return False
    method, target, major, minor = match.groups()
    return method in _METHODS and target.startswith(b"/") and major == b"1" and minor in (b"0", b"1")


def read_line(data: bytes) -> RequestLine:
    """Read the request line at the beginning of ``data``. Raises RequestLineError.

    The parser knows neither all methods (RFC 9110, 9.1) nor that HTTP/1.5 is served as HTTP/1.1 (2.5). Targets other
    than paths are left to the application, which explains what is wrong with them.
    """
    match = _REQUEST_LINE.match(data)
    if match is None:
        raise RequestLineError(HTTPStatus.BAD_REQUEST, "The request line is not one of HTTP/1.1.")
    method, target, major, minor = match.groups()
    if major != b"1":
        raise RequestLineError(HTTPStatus.HTTP_VERSION_NOT_SUPPORTED, "The major version of HTTP served here is 1.")
    other_method, other_target = b"", b""
    if method not in _METHODS:
        other_method, method = method, _ANY_METHOD
    if not target.startswith(b"/"):
        other_target, target = target, b"/"
    line = b"%b %b HTTP/1.%b\r\n" % (method, target, min(minor, b"1"))
    return RequestLine(line + data[match.end() :], other_method, other_target)
