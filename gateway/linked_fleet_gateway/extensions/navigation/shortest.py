"""The shortest way over a grid, by A* with eight neighbours. Pure.

Searches in pure Python expand a few hundred thousand cells a second, which is enough for floors of some thousand
square metres; no dependency is needed for that.
"""

from collections.abc import Container, Sequence
from heapq import heappop, heappush
from typing import NamedTuple

STRAIGHT, DIAGONAL = 10, 14
_FAR = 1 << 60


class Search(NamedTuple):
    """The cells of the way, from the start to the goal; none if there is none. ``seen`` are the cells reached."""

    cells: list[int]
    seen: bytearray


def search(
    cost: bytes, columns: int, start: int, goals: Container[int], estimate: Sequence[int] | None = None
) -> Search:
    """Find the way with the least cost to the first of ``goals``.

    ``cost`` of each cell is 0 if it cannot be passed, else the factor (1 to 255) of the way through it. The cells at
    the border have none. ``estimate`` is the least cost from each cell to the goal.
    """
    steps = [(offset, STRAIGHT) for offset in (1, -1, columns, -columns)]
    steps += [(offset, DIAGONAL) for offset in (columns + 1, columns - 1, 1 - columns, -1 - columns)]
    best, before, seen = [_FAR] * len(cost), dict[int, int](), bytearray(len(cost))
    left = estimate if estimate is not None else bytes(len(cost))
    best[start] = 0
    pending = [(left[start], start)]
    while pending:
        _, at = heappop(pending)
        if seen[at]:
            continue
        seen[at] = 1
        if at in goals:
            return Search(_back(before, at), seen)
        here = best[at]
        for offset, length in steps:
            there = at + offset
            factor = cost[there]
            if factor and not seen[there]:
                whole = here + length * factor
                if whole < best[there]:
                    best[there], before[there] = whole, at
                    heappush(pending, (whole + left[there], there))
    return Search([], seen)


def _back(before: dict[int, int], at: int) -> list[int]:
    found = [at]
    while (at := before.get(at, -1)) >= 0:
        found.append(at)
    return found[::-1]


def pocket(cost: bytes, columns: int, start: int, most: int, wanted: Container[int]) -> bytearray | None:
    """Return the cells around ``start`` from which nothing else is reached; None if they are many, or one is wanted."""
    seen, pending, count = bytearray(len(cost)), [start], 0
    seen[start] = 1
    while pending:
        at = pending.pop()
        count += 1
        if count > most or at in wanted:
            return None
        for offset in (1, -1, columns, -columns, columns + 1, columns - 1, 1 - columns, -1 - columns):
            there = at + offset
            if cost[there] and not seen[there]:
                seen[there] = 1
                pending.append(there)
    return seen
