"""Fields of requests and responses: their common grammar, preferences of clients, and links.

The grammar (RFC 9110, 5.6) has tokens, quoted strings, parameters and comma lists. Preferences are in ``Prefer`` (RFC
7240). Links are in a bounded ``Link`` field (RFC 8288), and their complete set in a document (RFC 9264).
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple, Protocol
from urllib.parse import quote as percent

from linked_fleet_gateway.http.arrival import Arrival

TOKEN = re.compile(r"[!#$%&'*+.^_`|~0-9A-Za-z-]+")
# A quoted string is consumed whole, closed or not, so that hostile fields take one pass.
_PIECE = re.compile(r'"(?:[^"\\]++|\\.)*+"?|[,;]|[^",;]+', re.DOTALL)

_PLAIN = re.compile(r"[ !#-\[\]-~]*")
"""Text that is the same in a quoted string."""


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
    if _PLAIN.fullmatch(text):
        return f'"{text}"'
    printable = re.sub(r"[\x00-\x1f\x7f]", " ", text)
    return '"' + printable.replace("\\", "\\\\").replace('"', '\\"') + '"'


class _Arrived(Protocol):
    arrival: Arrival


def field(request: _Arrived, name: str) -> str | None:
    """All lines of a list-valued field as one value (RFC 9110, 5.3); None when there is none."""
    found = request.arrival.fields.get(name.encode())
    return found.decode("latin-1") if found else None


MAX_WAIT_S = 60.0
Return = Literal["minimal", "representation"]


@dataclass(frozen=True)
class Prefer:
    """The known preferences; unknown and malformed ones are ignored (section 2)."""

    return_: Return | None = None
    respond_async: bool = False
    wait_s: float | None = None
    dry_run: bool = False
    """Our own preference: describe the effect of the action without executing it."""
    include: frozenset[str] = frozenset()
    omit: frozenset[str] = frozenset()
    """IRIs of parts of a representation to include and to omit (LDP 7.2)."""
    strict: bool = False
    """``handling=strict`` (4.4): what cannot be honoured is refused."""
    ignored: tuple[str, ...] = ()
    """The members that are unknown or malformed."""


NO_PREFERENCE = Prefer()


def parse_prefer(header: str | None) -> Prefer:
    """Parse the field, with several lines joined by commas; the first of a repeated preference counts."""
    if not header:
        return NO_PREFERENCE
    said: dict[str, str] = {}
    parts: dict[str, str] = {}
    ignored: list[str] = []
    for member in split(header, ","):
        preference, *rest = split(member, ";") or [""]
        name, equals, value = (part.strip(" \t") for part in preference.partition("="))
        text = unquote(value) if equals else ""
        # section 2: an empty value equals none
        if TOKEN.fullmatch(name) and (text is not None or value == ""):
            if name.lower() == "return" and "return" not in said:
                parts = dict(each for each in parameters(rest) if each is not None)
            said.setdefault(name.lower(), text or "")
            if _is_known(name.lower(), text or ""):
                continue
        ignored.append(member)
    return Prefer(
        _return(said.get("return")),
        said.get("respond-async") == "",
        _wait(said.get("wait")),
        "dry-run" in said,
        frozenset(parts.get("include", "").split()),
        frozenset(parts.get("omit", "").split()),
        said.get("handling") == "strict",
        tuple(ignored),
    )


def _is_known(name: str, value: str) -> bool:
    if name in ("respond-async", "dry-run"):
        return name == "dry-run" or not value
    if name == "handling":
        return value in ("strict", "lenient")
    return (name == "return" and _return(value) is not None) or (name == "wait" and _wait(value) is not None)


def _return(value: str | None) -> Return | None:
    return "minimal" if value == "minimal" else "representation" if value == "representation" else None


def _wait(value: str | None) -> float | None:
    """Return delta-seconds, digits only, at most ``MAX_WAIT_S``."""
    if value is None or not re.fullmatch(r"[0-9]+", value):
        return None
    return min(float(value), MAX_WAIT_S)


LINKSET_TYPES = ("application/linkset+json", "application/linkset")
# RFC 3986, 2: reserved and unreserved characters and existing %XX stay; everything else is percent-encoded.
_LEAST_BYTES = len('<>; rel="", ')
_SAFE = "!#$%&'()*+,/:;=?@[]~"
_ENCODED = re.compile(r"[A-Za-z0-9_.~!#$&'()*+,/:;=?@\[\]-]*")
"""Targets without anything to encode."""


class Link(NamedTuple):
    """A link from the present resource to ``target``.

    ``type`` is a hint of its media type. ``etag`` is the state of a collection of which the response is a page (WoT
    Discovery, 7.3.2.3).
    """

    target: str
    rel: str
    type: str | None = None
    etag: str | None = None


def link_header(
    own_links: Sequence[Link], part_links: Sequence[Link], linkset: str | None = None, limit: int = 4096
) -> str:
    """Return the field value, shorter than ``limit``: own links, then parts as they fit, then the link set if given.

    Room for the link set is reserved first, because it contains the links that do not fit.
    """
    last = [_member(Link(linkset, "linkset", LINKSET_TYPES[0]))] if linkset else []
    last = [member for member in last if len(member) < limit]
    room = limit - sum(len(member) + 2 for member in last)
    members: list[str] = []
    for link in [*own_links, *part_links]:
        if len(link.target) + len(link.rel) + _LEAST_BYTES >= room:
            continue
        member = _member(link)
        if len(member) + 2 >= room:
            continue
        room -= len(member) + 2
        members.append(member)
    return ", ".join([*members, *last])


def _target(target: str) -> str:
    if _ENCODED.fullmatch(target):
        return target
    encoded = percent(target, safe=_SAFE)
    return re.sub(r"%(?![0-9A-Fa-f]{2})", "%25", encoded)


def _member(link: Link) -> str:
    return f"<{_target(link.target)}>{_link_parameters(*link[1:])}"


@lru_cache(maxsize=256)
def _link_parameters(rel: str, media_type: str | None, etag: str | None) -> str:
    kind = f"; type={quote(media_type)}" if media_type else ""
    state = f"; etag={quote(etag)}" if etag else ""
    return f"; rel={quote(_ascii(rel))}{kind}{state}"


def _ascii(text: str) -> str:
    """Percent-encode non-ASCII characters in a relation."""
    return text if text.isascii() else percent(text, safe=_SAFE + ' "\\')


def linkset_json(anchor: str, links: Sequence[Link]) -> bytes:
    """Return application/linkset+json (RFC 9264, 4.2): one link context object, targets grouped by relation."""
    context: dict[str, Any] = {"anchor": _target(anchor)}
    for link in links:
        target = {"href": _target(link.target)} | ({"type": link.type} if link.type else {})
        # a relation "anchor" would overwrite the context; no such relation is registered
        if link.rel != "anchor":
            context.setdefault(link.rel, []).append(target)
    return json.dumps({"linkset": [context]}, ensure_ascii=False).encode()


def linkset_text(anchor: str, links: Sequence[Link]) -> bytes:
    """Return application/linkset (RFC 9264, 4.1): the field syntax, one link per line, each with its anchor."""
    return ",\n".join(f"{_member(link)}; anchor={quote(_target(anchor))}" for link in links).encode()
