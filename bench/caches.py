"""The latency of memory: other tenants' use of a machine's caches differs from hour to hour.

A program as large as the gateway does not fit into a processor's own cache (1 MiB here); a loop of a few lines, like
the bare server, always fits. In such hours the gateway gets slower, but the bare server does not.
"""

import random
import time
from array import array

from bench.table import Row, known

_KIB = (8, 768, 8 * 1024)
_READS = 200_000
_NAME = "a read at random in {} KiB, with one turn of a loop"


def reads() -> list[Row]:
    """Return the nanoseconds of a random read, by the size of the memory that is read."""
    least, unit = _step_ns(_KIB[0]), "ns CPU"
    return [
        known(_NAME.format(_KIB[0]), unit, least),
        *(known(_NAME.format(size), unit, _step_ns(size), f"{_KIB[0]} KiB", least) for size in _KIB[1:]),
    ]


def _step_ns(kib: int) -> float:
    places = _circle(kib * 1024 // 8)
    at = 0
    for _ in range(len(places)):  # load it into the caches, as far as it fits
        at = places[at]
    begin = time.process_time_ns()
    for _ in range(_READS):
        at = places[at]
    return (time.process_time_ns() - begin) / _READS


def _circle(length: int) -> "array[int]":
    """Return a random cycle through all places, so that no read can begin before the previous one has ended."""
    order = list(range(length))
    random.Random(1).shuffle(order)  # noqa: S311 - not a secret
    places = array("q", bytes(8 * length))
    for here, following in zip(order, [*order[1:], order[0]], strict=True):
        places[here] = following
    return places
