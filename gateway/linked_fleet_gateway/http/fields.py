"""The common grammar of HTTP fields (RFC 9110, 5.6): tokens, quoted strings, parameters, comma lists."""

import re
from collections.abc import Iterator

from starlette.requests import HTTPConnection

from linked_fleet_gateway.http.arrival import arrival_of

TOKEN = re.compile(r"[!#$%&'*+.^_`|~0-9A-Za-z-]+")
# A quoted string is consumed whole, closed or not, so that hostile fields take one pass.
_PIECE = re.compile(r'"(?:[^"\\]++|\\.)*+"?|[,;]|[^",;]+', re.DOTALL)


def split(field: str, separator: str) -> list[str]:
    """Return the stripped parts between separators outside quoted strings; empty parts are dropped (5.6.1)."""
    parts, current = [], ""
    for match in _PIECE.finditer(field):
        if match[0] == separator:
            parts.append(current)
            current = ""
        else:
            current += match[0]
    return [part for part in (part.strip(" \t") for part in [*parts, current]) if part]


def parameters(parts: list[str]) -> Iterator[tuple[str, str] | None]:
    """Yield pairs of a lower-case name and an unquoted value; None for a malformed part."""
    for part in parts:
        name, equals, value = part.partition("=")
        text = unquote(value)
        yield (name.lower(), text) if equals and TOKEN.fullmatch(name) and text is not None else None


def unquote(value: str) -> str | None:
    """Return the text of a token or quoted string (5.6.4); None if it is neither."""
    if TOKEN.fullmatch(value):
        return value
    if re.fullmatch(r'"(?:[^"\\]++|\\.)*+"', value):
        return re.sub(r"\\(.)", r"\1", value[1:-1])
    return None


def quote(text: str) -> str:
    """Return a quoted string, with control characters replaced by spaces."""
    printable = re.sub(r"[\x00-\x1f\x7f]", " ", text)
    return '"' + printable.replace("\\", "\\\\").replace('"', '\\"') + '"'


def field(request: HTTPConnection, name: str) -> str | None:
    """All lines of a list-valued field as one value (RFC 9110, 5.3); None when there is none."""
    found = arrival_of(request.scope).fields.get(name.encode())
    return found.decode("latin-1") if found else None
