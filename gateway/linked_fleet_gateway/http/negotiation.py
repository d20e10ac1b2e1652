"""Proactive content negotiation (RFC 9110, 12.5.1) and media types of request bodies (8.3)."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from linked_fleet_gateway.base.errors import BadRequest, UnsupportedMediaType
from linked_fleet_gateway.http.fields import TOKEN, parameters, split

_WEIGHT = re.compile(r"0(?:\.[0-9]{0,3})?|1(?:\.0{0,3})?")
_SHORT = 256
"""Longer fields are not cached."""
_OUR_CHARSETS = ("utf-8", "utf8", "us-ascii")


@dataclass(frozen=True)
class MediaRange:
    """One member of ``Accept``: ``*/*``, ``text/*`` or a media type, with parameters and weight."""

    type: str
    subtype: str
    parameters: tuple[tuple[str, str], ...] = ()
    q: float = 1.0

    @property
    def specificity(self) -> tuple[bool, bool, int]:
        return (self.type != "*", self.subtype != "*", len(self.parameters))

    def matches(self, media_type: str) -> bool:
        kind, offered = _media_type(media_type) or ("", {})
        main, _, sub = kind.partition("/")
        # All responses are UTF-8, so a charset parameter excludes nothing. A profile never does (RFC 6906, 3), and an
        # RDF version is the highest that the client reads (RDF 1.2 Turtle, media type registration), which includes RDF
        # 1.1.
        ours = {("charset", "utf-8"), ("charset", "utf8")}
        ignored = {"profile", "version"} - offered.keys()
        asked = [(n, v) for n, v in self.parameters if n not in ignored and (n, v.lower()) not in ours]
        return self.type in ("*", main) and self.subtype in ("*", sub) and all(offered.get(n) == v for n, v in asked)


def parse_accept(header: str | None) -> list[MediaRange]:
    """Return the members in order; malformed ones are ignored."""
    found = (_media_range(member) for member in split(header or "", ","))
    return [media_range for media_range in found if media_range is not None]


def _media_range(member: str) -> MediaRange | None:
    kind, *rest = split(member, ";") or [""]
    main, slash, sub = kind.lower().partition("/")
    if not (slash and TOKEN.fullmatch(main) and TOKEN.fullmatch(sub)) or (main == "*" and sub != "*"):
        return None
    named: list[tuple[str, str]] = []
    for parameter in parameters(rest):
        if parameter is None:
            return None
        if parameter[0] == "q":
            # parameters after the weight were extensions, which RFC 9110 removed
            weight = parameter[1]
            return MediaRange(main, sub, tuple(named), float(weight)) if _WEIGHT.fullmatch(weight) else None
        named.append(parameter)
    return MediaRange(main, sub, tuple(named))


def choose(header: str | None, offered: Sequence[str]) -> str | None:
    """Return the offered type that the client prefers, the first of equals; None if all are excluded."""
    choice = _choice if header is None or len(header) <= _SHORT else _choice.__wrapped__
    return choice(header, tuple(offered))


@lru_cache(maxsize=1024)
def _choice(header: str | None, offered: tuple[str, ...]) -> str | None:
    ranges = parse_accept(header)
    if not ranges:
        return offered[0] if offered else None
    weights = {media_type: weight(ranges, media_type) for media_type in offered}
    best = max(weights.values(), default=0.0)
    return next((media_type for media_type in offered if weights[media_type] == best), None) if best > 0 else None


def weight(ranges: Sequence[MediaRange], media_type: str) -> float:
    """Return the q of the most specific matching range; 0 if none matches."""
    matching = [media_range for media_range in ranges if media_range.matches(media_type)]
    return max(matching, key=lambda found: found.specificity).q if matching else 0.0


@lru_cache(maxsize=256)
def _media_type(header: str) -> tuple[str, dict[str, str]] | None:
    kind, *rest = split(header, ";") or [""]
    main, slash, sub = kind.lower().partition("/")
    named = [parameter for parameter in parameters(rest) if parameter is not None]
    if not (slash and TOKEN.fullmatch(main) and TOKEN.fullmatch(sub)) or len(named) != len(rest):
        return None
    return f"{main}/{sub}", dict(named)


def parse_content_type(header: str | None, accepted: Sequence[str] = ()) -> tuple[str, Mapping[str, str]]:
    """Return the lower-case media type and parameters of a Content-Type field.

    ``accepted`` are the supported media types; any other raises 415 with this list. Raises 415 without a field or for
    another charset, 400 for a malformed one.
    """
    if header is None or not header.strip():
        raise UnsupportedMediaType("the body has no Content-Type", offered=accepted)
    parsed = _media_type(header)
    if parsed is None:
        raise BadRequest(f"Content-Type {header!r} is not a media type such as text/turtle; charset=utf-8")
    media_type, named = parsed
    if accepted and media_type not in accepted:
        raise UnsupportedMediaType(f"{media_type} is not taken here; {', '.join(accepted)} is", offered=accepted)
    charset = named.get("charset", "utf-8")
    if charset.lower() not in _OUR_CHARSETS:
        raise UnsupportedMediaType(f"charset {charset!r} is not taken; utf-8 is", offered=accepted)
    return media_type, dict(named)
