"""Content negotiation: media types (RFC 9110, 12.5.1 and 8.3) and content codings (8.4.1).

Contents from a kilobyte are coded if the client accepts it (12.5.3). Dynamic contents are coded in gzip; constant ones
may be stored in other codings too (``Rendition.codings``). Zstandard would make dynamic contents 0 to 5 %
shorter, in half of the 30 to 60 microseconds that gzip takes for a robot or an action, and would be a dependency.
Contents with measured values change with each frame, and are coded from four kilobytes: shorter ones would cost a third
more and save a packet. Pages for logged-in persons are not coded, because the length of compressed content could reveal
a secret next to content chosen by others.
"""

import gzip
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from linked_fleet_base.errors import BadRequest, UnsupportedMediaType
from linked_fleet_gateway.http.fields import TOKEN, parameters, split

_WEIGHT = re.compile(r"0(?:\.[0-9]{0,3})?|1(?:\.0{0,3})?")
_SHORT = 256
"""Longer fields are cached while their requests last: a request is negotiated several times."""
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
        if self.type not in ("*", main) or self.subtype not in ("*", sub):
            return False
        # All responses are UTF-8, so a charset parameter excludes nothing. A profile never does (RFC 6906, 3), and an
        # RDF version is the highest that the client reads (RDF 1.2 Turtle, media type registration), which includes RDF
        # 1.1. All our CSV has a header line (RFC 4180, 3).
        ours = {("charset", "utf-8"), ("charset", "utf8"), ("header", "present")}
        ignored = {"profile", "version"} - offered.keys()
        asked = [(n, v) for n, v in self.parameters if n not in ignored and (n, v.lower()) not in ours]
        return all(offered.get(n) == v for n, v in asked)


def parse_accept(header: str | None) -> Sequence[MediaRange]:
    """Return the members in order; malformed ones are ignored."""
    return _ranges(header or "") if header is None or len(header) <= _SHORT else _long_ranges(header)


def _parsed(header: str) -> Sequence[MediaRange]:
    found = (_media_range(member) for member in split(header, ","))
    return tuple(media_range for media_range in found if media_range is not None)


_ranges, _long_ranges = lru_cache(1024)(_parsed), lru_cache(16)(_parsed)


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


def choose(header: str | None, offered: Sequence[str], equivalent: tuple[str, str] | None = None) -> str | None:
    """Return the offered type that the client prefers, the first of equals; None if all are excluded.

    ``equivalent``: an offered type, and a type whose readers can read it.
    """
    choice = _choice if header is None or len(header) <= _SHORT else _choice_of_long
    return choice(header, tuple(offered), equivalent)


def _choose(header: str | None, offered: tuple[str, ...], also: tuple[str, str] | None) -> str | None:
    ranges = parse_accept(header)
    if not ranges:
        return offered[0] if offered else None
    weights = {media_type: weight(ranges, media_type) for media_type in offered}
    if also is not None:
        weights[also[0]] = max(weights[also[0]], weight(ranges, also[1]))
    best = max(weights.values(), default=0.0)
    return next((media_type for media_type in offered if weights[media_type] == best), None) if best > 0 else None


_choice, _choice_of_long = lru_cache(1024)(_choose), lru_cache(64)(_choose)


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


LEAST_BYTES, MOST_BYTES = 1024, 512 * 1024
"""Shorter contents gain nothing. Longer ones are compressed in a thread, which takes more than five milliseconds."""
LEAST_MEASURED_BYTES = 4096
_LEVEL = 3
GZIP = (b"content-encoding", b"gzip")


def is_compressible(content: bytes, measured: bool, max_bytes: int = MOST_BYTES) -> bool:
    """Return True if the content is worth compressing and has at most ``max_bytes`` bytes.

    ``measured``: it has values that change.
    """
    return (LEAST_MEASURED_BYTES if measured else LEAST_BYTES) <= len(content) <= max_bytes


def compress(content: bytes) -> bytes:
    """Return the content in gzip; deterministic."""
    return gzip.compress(content, _LEVEL, mtime=0)


def decompress(content: bytes) -> bytes:
    """Undo ``compress``."""
    return gzip.decompress(content)


def coded_tag(tag: str, coding: str) -> str:
    """Return the entity tag of a representation in the coding, whose bytes differ (RFC 9110, 8.8.3.3)."""
    return f'{tag[:-1]}-{coding}"' if coding else tag


@lru_cache(maxsize=256)
def accepts_gzip(accept_encoding: bytes) -> bool:
    """Return True if an Accept-Encoding field prefers gzip to no coding."""
    return preferred_coding(accept_encoding, ("gzip",)) == "gzip"


@lru_cache(maxsize=256)
def preferred_coding(accept_encoding: bytes, offered: tuple[str, ...]) -> str:
    """Return the coding of ``offered`` that Accept-Encoding prefers, the first of equals; empty for none."""
    weights: dict[str, float] = {}
    for member in accept_encoding.decode("latin-1").lower().split(","):
        coding, _, parameter = member.partition(";")
        name, _, value = parameter.strip().partition("=")
        try:
            weights[coding.strip()] = float(value) if name.strip() == "q" else 1.0
        except ValueError:
            return ""
    taken = {each: weights.get(each, weights.get(f"x-{each}", weights.get("*", 0.0))) for each in offered}
    best = max(taken, key=taken.__getitem__, default="")
    return best if best and 0 < taken[best] >= weights.get("identity", 0.0) else ""
