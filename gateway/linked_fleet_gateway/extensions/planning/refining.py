"""Paths that are made quicker between their ends, after shortcuts have removed their detours. Radian, metre.

What counts is the time that the joints need at their highest speeds: on each piece that of the joint which needs
longest. Parts of the path, of one joint or of all, are moved towards the straight line between the ends of the part.
"""

import math
import time
from collections.abc import Sequence
from itertools import pairwise
from random import Random

import numpy as np
from roboplan.core import JointPath, Scene, hasCollisionsAlongPath

from linked_fleet_gateway.extensions.world.surfaces import Array

_PIECE = 0.3
"""Length of the pieces into which the path is divided, in joints (rad, m)."""
_OF_ALL = 0.1
"""Weight of the mean of the joints beside the slowest one, so that the others have no detours either."""
_LEAST_GAIN_S = 1e-4
_ONE_JOINT = 0.5
"""Share of the attempts that move one joint."""
_TOWARDS_LINE = (1.0, 0.5, 0.25)
_STRAIGHT = 0.02
"""Largest distance of places from a straight line that replaces them (rad, m)."""


def refined(scene: Scene, path: JointPath, speeds: Array, step: float, within_s: float, seed: int) -> JointPath:
    """Return a free path with the same ends that is quicker, if one is found in the time."""
    rows = _divided([np.array(each) for each in path.positions])
    if len(rows) < 3:
        return path
    random, ends_s = Random(seed), time.monotonic() + within_s  # noqa: S311 - where to try
    while time.monotonic() < ends_s:
        first = random.randrange(len(rows) - 2)
        last = min(len(rows) - 1, first + random.randrange(2, len(rows)))
        part = rows[first : last + 1]
        changed = _changed(part, speeds, random)
        if _time(changed, speeds) < _time(part, speeds) - _LEAST_GAIN_S and _is_free(scene, changed, step):
            rows[first : last + 1] = changed
    found = JointPath()
    found.joint_names, found.positions = path.joint_names, _without_needless(scene, rows, step)
    return found


def _divided(rows: Sequence[Array]) -> Array:
    found = [rows[0]]
    for one, other in pairwise(rows):
        count = max(1, math.ceil(float(np.abs(other - one).max()) / _PIECE))
        found += [one + (other - one) * k / count for k in range(1, count + 1)]
    return np.array(found)


def _times(rows: Array, speeds: Array) -> Array:
    shares = np.abs(np.diff(rows, axis=0)) / speeds
    found: Array = shares.max(axis=1) + _OF_ALL * shares.mean(axis=1)
    return found


def _time(rows: Array, speeds: Array) -> float:
    return float(_times(rows, speeds).sum())


def _changed(part: Array, speeds: Array, random: Random) -> Array:
    """Return a part of a path, moved towards the straight line between its ends."""
    until = np.concatenate([[0.0], np.cumsum(_times(part, speeds))])
    shares = until / until[-1] if until[-1] > 0.0 else np.linspace(0.0, 1.0, len(part))
    line = part[0] + (part[-1] - part[0]) * shares[:, None]
    if random.random() < _ONE_JOINT:
        found, joint = part.copy(), random.randrange(part.shape[1])
        found[:, joint] = line[:, joint]
        return found
    towards: Array = part + (line - part) * random.choice(_TOWARDS_LINE)
    return towards


def _is_free(scene: Scene, rows: Array, step: float) -> bool:
    return not any(hasCollisionsAlongPath(scene, one, other, step) for one, other in pairwise(rows))


def _without_needless(scene: Scene, rows: Array, step: float) -> list[Array]:
    """Return the rows without those that are on a free straight line between others."""
    kept, last = [0], len(rows) - 1
    while kept[-1] < last:
        here, there = kept[-1], last
        while there > here + 1 and not _is_straight(scene, rows[here : there + 1], step):
            there = (here + there) // 2
        kept.append(there)
    return [rows[k] for k in kept]


def _is_straight(scene: Scene, rows: Array, step: float) -> bool:
    way = rows[-1] - rows[0]
    shares = np.clip((rows - rows[0]) @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
    off = np.abs(rows - rows[0] - shares[:, None] * way).max()
    return bool(off < _STRAIGHT) and not hasCollisionsAlongPath(scene, rows[0], rows[-1], step)
