"""Content codings (RFC 9110, 8.4.1) of contents from a kilobyte, if the client accepts them (12.5.3).

Dynamic contents are coded in gzip; constant ones may be stored in other codings too (``Resource.coded``). Zstandard
would make dynamic contents 0 to 5 % shorter, in half of the 30 to 60 microseconds that gzip takes for a robot or an
action, and would be a dependency. Contents with measured values change with each frame, and are coded from four
kilobytes: shorter ones would cost a third more and save a packet. Pages for logged-in persons are not coded, because
the length of compressed content could reveal a secret next to content chosen by others.
"""

import gzip
from functools import lru_cache

LEAST_BYTES, MOST_BYTES = 1024, 512 * 1024
"""Shorter contents gain nothing, and longer ones would block the event loop for more than five milliseconds."""
LEAST_MEASURED_BYTES = 4096
_LEVEL = 3
GZIP = (b"content-encoding", b"gzip")


def is_compressible(content: bytes, measured: bool) -> bool:
    """Return True if compressing the content is worthwhile; ``measured``: it has values that change."""
    return (LEAST_MEASURED_BYTES if measured else LEAST_BYTES) <= len(content) <= MOST_BYTES


def compressed(content: bytes) -> bytes:
    """Return the content in gzip; deterministic."""
    return gzip.compress(content, _LEVEL, mtime=0)


def expanded(content: bytes) -> bytes:
    """Undo ``compressed``."""
    return gzip.decompress(content)


def coded_tag(tag: str, coding: str) -> str:
    """Return the entity tag of a representation in the coding, whose bytes differ (RFC 9110, 8.8.3.3)."""
    return f'{tag[:-1]}-{coding}"' if coding else tag


def takes_gzip(accept_encoding: bytes) -> bool:
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
