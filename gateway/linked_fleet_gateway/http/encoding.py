"""Content codings (RFC 9110, 8.4.1) for contents of a kilobyte and more, where the client takes them (12.5.3).

What is made for a request is coded in gzip; what never changes may be kept in other codings too (``Resource.coded``).

Measured values and pages of somebody who has logged in are sent as they are: values change faster than it pays, and
the length of compressed content could tell a secret beside what others have put in.
"""

import gzip
from functools import lru_cache

LEAST_BYTES, MOST_BYTES = 1024, 512 * 1024
"""Shorter contents gain nothing, and longer ones would hold the event loop for more than five milliseconds."""
_LEVEL = 3
GZIP = (b"content-encoding", b"gzip")


def pays(content: bytes) -> bool:
    """Tell whether the content is worth a content coding."""
    return LEAST_BYTES <= len(content) <= MOST_BYTES


def compressed(content: bytes) -> bytes:
    """Return the content in the coding gzip; the same bytes for the same content."""
    return gzip.compress(content, _LEVEL, mtime=0)


def expanded(content: bytes) -> bytes:
    """Return what ``compressed`` was given."""
    return gzip.decompress(content)


def tag_of(tag: str, coding: str) -> str:
    """The entity tag of a representation in the coding: its bytes are others (RFC 9110, 8.8.3.3)."""
    return f'{tag[:-1]}-{coding}"' if coding else tag


def takes_gzip(accept_encoding: bytes) -> bool:
    """Tell whether an Accept-Encoding field takes gzip rather than no coding."""
    return chosen(accept_encoding, ("gzip",)) == "gzip"


@lru_cache(maxsize=256)
def chosen(accept_encoding: bytes, offered: tuple[str, ...]) -> str:
    """The coding of those ``offered`` that an Accept-Encoding field prefers, the first of several; empty for none."""
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
