"""The shortest way over a grid, by A* with eight neighbours. Pure.

Searches in pure Python expand a few hundred thousand cells a second, which is enough for floors of some thousand
square metres; no dependency is needed for that.
"""

from collections.abc import Container, Sequence
from heapq import heappop, heappush

STRAIGHT, DIAGONAL = 10, 14
_FAR = 1 << 60


def search(
    cost: bytes, columns: int, start: int, goals: Container[int], estimate: Sequence[int] | None = None
) -> list[int]:
    """Return the cells of the way with the least cost to one of ``goals``, with the start; none if there is no way.

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
            return _back(before, at)
        here = best[at]
        for offset, length in steps:
            there = at + offset
            factor = cost[there]
            if factor and not seen[there]:
                whole = here + length * factor
                if whole < best[there]:
                    best[there], before[there] = whole, at
                    heappush(pending, (whole + left[there], there))
    return []


def _back(before: dict[int, int], at: int) -> list[int]:
    found = [at]
    while (at := before.get(at, -1)) >= 0:
        found.append(at)
    return found[::-1]
