"""Paths on which the tip keeps to constraints: what the search projects on, and how such a path is shortened."""

import math
from collections.abc import Iterator, Sequence
from random import Random

import numpy as np
from roboplan.core import JointPath, Scene, hasCollisionsAlongPath
from roboplan.rrt import ConstraintProjector, PoseConstraint

from linked_fleet_gateway.extensions.planning.messages import Constraints
from linked_fleet_gateway.extensions.world.messages import Check
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import se3

_INSIDE = 0.9
"""Share of what is allowed that the search uses, so that rounded corners are within it."""
_INSIDE_M = 0.005
_ENDS = 1e-4
"""By how much starts and goals may be rounded."""
_SHORTER_TRIES = 200
_APART = 0.05
"""Least distance of places of a path (rad, m)."""


class Corridor:
    """The configurations in which the frame ``tip`` of a scene keeps to constraints. ``ends`` are start and goals."""

    def __init__(self, scene: Scene, around: Check, keeps: Constraints, ends: Sequence[Array], step: float) -> None:
        self._scene, self._step = scene, step
        root = se3(around.robot.base).inverse()
        self.constraints: list[PoseConstraint] = []
        for (lower, upper), at in self._regions(keeps):
            region = np.asfortranarray(root.homogeneous @ at)
            free = PoseConstraint(scene, "", "tip", tform=region)
            ends_at = np.array([free.computeDisplacement(end) for end in ends])
            lower = np.minimum(lower, ends_at.min(axis=0) - _ENDS)
            upper = np.maximum(upper, ends_at.max(axis=0) + _ENDS)
            self.constraints.append(PoseConstraint(scene, "", "tip", lower, upper, region))
        self._projector = ConstraintProjector(scene, "", self.constraints)

    def _regions(self, keeps: Constraints) -> Iterator[tuple[tuple[Array, Array], Array]]:
        """Yield lower and upper bounds of x, y, z, roll, pitch and yaw in a frame of the world, and that frame."""
        if keeps.upright is not None and keeps.upright < math.pi / 2:
            most = np.full(6, math.inf)
            most[3:5] = _INSIDE * keeps.upright / math.sqrt(2.0)
            yield (-most, most), np.eye(4)
        if keeps.stay_in is not None:
            low, high = map(np.array, keeps.stay_in)
            frame, half = np.eye(4), np.full(6, math.inf)
            frame[:3, 3] = (low + high) / 2
            half[:3] = np.maximum((high - low) / 2 - _INSIDE_M, (high - low) / 4)
            yield (-half, half), frame

    def contains(self, one: Array, other: Array) -> bool:
        """Return True if the straight line between two configurations keeps to the constraints, and is free."""
        return self._projector.satisfiesAlongPath(one, other, self._step) and not hasCollisionsAlongPath(
            self._scene, one, other, self._step
        )

    def shortened(self, path: JointPath, seed: int) -> JointPath:
        """Return a path with straight lines in place of parts of it."""
        random, rows = Random(seed), [np.array(each) for each in path.positions]  # noqa: S311 - where to try
        for _ in range(_SHORTER_TRIES):
            if len(rows) <= 2:
                break
            first, last = sorted(random.sample(range(len(rows)), 2))
            if last - first > 1 and self.contains(rows[first], rows[last]):
                del rows[first + 1 : last]
        return self._path(path, rows)

    def _path(self, like: JointPath, rows: Sequence[Array]) -> JointPath:
        """Return a path through rows, without those that are near others, which TOPP-RA has trouble with."""
        kept = [rows[0]]
        for row in rows[1:-1]:
            if min(np.linalg.norm(row - kept[-1]), np.linalg.norm(row - rows[-1])) > _APART:
                kept.append(row)
        found = JointPath()
        found.joint_names, found.positions = like.joint_names, [*kept, rows[-1]]
        return found
