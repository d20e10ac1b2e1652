"""The part of a grid that can be reached from one of its cells. Pure.

Cells are joined to runs along the rows first: a floor of 300,000 cells has some thousand runs, between which a search
takes milliseconds.
"""

import numpy as np
import numpy.typing as npt

Bools = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.intp]


def region(free: Bools, start: int) -> Bools:
    """Return the cells that are reached from a free one, also by corners. Cells at the border are not free."""
    edges = np.flatnonzero(np.diff(free.ravel().astype(np.int8))) + 1
    begins, ends = edges[0::2], edges[1::2]
    seen = _joined(begins, ends, free.shape[1], int(np.searchsorted(begins, start, side="right")) - 1)
    steps = np.zeros(free.size, dtype=np.int8)
    steps[begins[seen]], steps[ends[seen]] = 1, -1
    reached: Bools = (np.cumsum(steps, dtype=np.int8) > 0).reshape(free.shape)
    return reached


def _joined(begins: Numbers, ends: Numbers, columns: int, first: int) -> Bools:
    """Return which runs are reached from the first one: they touch in the rows above and below."""
    beside = [
        range(low, high)
        for offset in (-columns, columns)
        for low, high in zip(
            np.searchsorted(ends, begins + offset - 1, side="right").tolist(),
            np.searchsorted(begins, ends + offset + 1, side="left").tolist(),
            strict=True,
        )
    ]
    seen, pending = bytearray(len(begins)), [first]
    seen[first] = 1
    while pending:
        at = pending.pop()
        for there in (*beside[at], *beside[at + len(begins)]):
            if not seen[there]:
                seen[there] = 1
                pending.append(there)
    return np.frombuffer(seen, dtype=np.bool_)
