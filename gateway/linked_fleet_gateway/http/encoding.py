"""Content coding gzip (RFC 9110, 8.4.1.3) for contents of a kilobyte and more, where the client takes it (12.5.3).

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


def tag_of(tag: str, coded: bool) -> str:
    """The entity tag of a representation in the coding: its bytes are others (RFC 9110, 8.8.3.3)."""
    return tag[:-1] + '-gzip"' if coded else tag


@lru_cache(maxsize=256)
def takes_gzip(accept_encoding: bytes) -> bool:
    """Tell whether an Accept-Encoding field takes gzip rather than no coding."""
    weights: dict[bytes, float] = {}
    for member in accept_encoding.lower().split(b","):
        coding, _, parameter = member.partition(b";")
        name, _, value = parameter.strip().partition(b"=")
        try:
            weights[coding.strip()] = float(value) if name.strip() == b"q" else 1.0
        except ValueError:
            return False
    wanted = weights.get(b"gzip", weights.get(b"x-gzip", weights.get(b"*", 0.0)))
    return wanted > 0 and wanted >= weights.get(b"identity", 0.0)
