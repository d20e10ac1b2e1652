"""The cells that can be reached from one."""

import random

import numpy as np
import pytest

from linked_fleet_gateway.extensions.navigation.region import Bools, region


def flooded(free: Bools, start: int) -> Bools:
    """Return the region cell by cell."""
    reached, pending = np.zeros_like(free), [divmod(start, free.shape[1])]
    while pending:
        row, column = pending.pop()
        if free[row, column] and not reached[row, column]:
            reached[row, column] = True
            pending += [(row + down, column + across) for down in (-1, 0, 1) for across in (-1, 0, 1)]
    return reached


@pytest.mark.parametrize("share", [0.2, 0.4, 0.6, 0.9])
@pytest.mark.parametrize("seed", range(5))
def test_it_is_what_a_flood_reaches(seed: int, share: float) -> None:
    chance = np.random.default_rng(seed)
    free = chance.random((30, 41)) < share
    free[[0, -1], :] = free[:, [0, -1]] = False
    start = random.Random(seed).choice(np.flatnonzero(free).tolist())
    assert (region(free, start) == flooded(free, start)).all()


def test_cells_touch_by_their_corners() -> None:
    free = np.zeros((5, 6), dtype=bool)
    free[1, 1] = free[2, 2] = free[3, 1] = free[1, 4] = True
    assert np.flatnonzero(region(free, 7)).tolist() == [7, 14, 19]
