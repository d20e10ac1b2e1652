"""The grammar that HTTP fields share (RFC 9110, 5.6): tokens, quoted strings, parameters, comma lists."""

import re
from collections.abc import Iterator

from starlette.requests import HTTPConnection

from linked_fleet_gateway.http.arrival import arrival_of

TOKEN = re.compile(r"[!#$%&'*+.^_`|~0-9A-Za-z-]+")
# A quoted string is swallowed whole, closed or not, so that hostile fields cost one pass.
_PIECE = re.compile(r'"(?:[^"\\]++|\\.)*+"?|[,;]|[^",;]+', re.DOTALL)


def split(field: str, separator: str) -> list[str]:
    """The parts between separators that stand outside quoted strings, stripped; empty parts are no parts (5.6.1)."""
    parts, current = [], ""
    for match in _PIECE.finditer(field):
        if match[0] == separator:
            parts.append(current)
            current = ""
        else:
            current += match[0]
    return [part for part in (part.strip(" \t") for part in [*parts, current]) if part]


def parameters(parts: list[str]) -> Iterator[tuple[str, str] | None]:
    """``name=value`` with the name lower-cased and the value unquoted; None for a part that is neither."""
    for part in parts:
        name, equals, value = part.partition("=")
        text = unquote(value)
        yield (name.lower(), text) if equals and TOKEN.fullmatch(name) and text is not None else None


def unquote(value: str) -> str | None:
    """The text of a token or quoted string (5.6.4), None when it is neither."""
    if TOKEN.fullmatch(value):
        return value
    if re.fullmatch(r'"(?:[^"\\]++|\\.)*+"', value):
        return re.sub(r"\\(.)", r"\1", value[1:-1])
    return None


def quote(text: str) -> str:
    """A quoted string; control characters, which no field can hold, become spaces."""
    printable = re.sub(r"[\x00-\x1f\x7f]", " ", text)
    return '"' + printable.replace("\\", "\\\\").replace('"', '\\"') + '"'


def field(request: HTTPConnection, name: str) -> str | None:
    """All lines of a list-valued field as one value (RFC 9110, 5.3); None when there is none."""
    found = arrival_of(request.scope).fields.get(name.encode())
    return found.decode("latin-1") if found else None
