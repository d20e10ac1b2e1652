"""The fastest motion along a path of corners: TOPP-RA within speeds and accelerations. Radian, metre, second.

Corners are rounded as far as the rounded path is free. The waypoints are as dense as a command takes, so that the
curve through them, which agents and the collision check compute, stays next to the path.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from roboplan.core import JointPath, Scene
from roboplan.toppra import PathParameterizerTOPPRA, SplineFittingMode, TOPPRAOptions

from linked_fleet_gateway.extensions.world.path import highest_speed
from linked_fleet_gateway.extensions.world.questions import waypoint_velocities
from linked_fleet_gateway.extensions.world.surfaces import Array

STEP_S, FINE_STEP_S = 0.03, 0.01
MOST_WAYPOINTS, MOST_POSITIONS = 1_000, 16_384
"""The most that one command of an agent may have."""
_ROUNDINGS = (0.3, 0.1)
_SHARE = 0.98
"""Share of the speed limits, so that the curve through the waypoints stays within them."""
_SHORTEST_S = 0.005
_SAMPLES = 3
"""Places of the curve that are looked at from one waypoint to the next."""


class Timed:
    """A path in time: rows of positions, one for each of ``times_s``, the first at the start."""

    def __init__(self, times_s: Sequence[float], positions: Array) -> None:
        self.times_s, self.positions = np.array(times_s, dtype=float), positions

    @property
    def duration_s(self) -> float:
        return float(self.times_s[-1])


def quickly_timed_s(scene: Scene, path: JointPath) -> float | None:
    """Return how long the path takes with a stop at each corner; None if it has no such motion."""
    options = TOPPRAOptions(dt=STEP_S, mode=SplineFittingMode.Hermite, velocity_scale=_SHARE)
    try:
        return float(PathParameterizerTOPPRA(scene).generate(path, options).times[-1])
    except RuntimeError:
        return None


def fastest(
    scene: Scene, path: JointPath, speeds: Array, accepts: Callable[[Timed], bool] = lambda timed: True
) -> Timed | None:
    """Return the fastest motion along a path that is accepted, or None.

    ``speeds`` are the limits of its joints, in order.
    """
    parameterizer = PathParameterizerTOPPRA(scene)
    best: Timed | None = None
    for mode, rounding in ((SplineFittingMode.Cubic, 0.0), *((SplineFittingMode.LinearBlend, r) for r in _ROUNDINGS)):
        if mode is SplineFittingMode.Cubic and len(path.positions) <= 2:
            continue
        options = TOPPRAOptions(dt=STEP_S, mode=mode, velocity_scale=_SHARE, max_blend_deviation=rounding)
        try:
            found = parameterizer.generate(path, options)
        except (RuntimeError, MemoryError):  # of numerical trouble with this curve, which may seem to take for ever
            continue
        if len(found.times) < 2:  # numerical trouble too
            continue
        timed = _thinned(found.times, np.array(found.positions))
        if (best is None or timed.duration_s < best.duration_s) and accepts(timed):
            best = timed
    return None if best is None else _within(best, speeds)


def smooth(scene: Scene, path: JointPath, speeds: Array) -> Timed | None:
    """Return the fastest motion along a path of many places near each other, or None."""
    if len(path.positions) == 1:
        return None
    options = TOPPRAOptions(dt=FINE_STEP_S, mode=SplineFittingMode.Cubic, velocity_scale=_SHARE)
    try:
        found = PathParameterizerTOPPRA(scene).generate(path, options)
    except RuntimeError:  # of numerical trouble
        return None
    return _within(_thinned(found.times, np.array(found.positions)), speeds)


def _thinned(times_s: Sequence[float], positions: Array) -> Timed:
    """Return evenly spaced waypoints, with both ends, as many as fit into a command."""
    most = min(MOST_WAYPOINTS, MOST_POSITIONS // max(positions.shape[1], 1))
    keep = list(range(0, len(times_s), math.ceil(len(times_s) / most)))
    if times_s[-1] - times_s[keep[-1]] < _SHORTEST_S and len(keep) > 1:
        keep.pop()  # the last step may be a rounding error
    if keep[-1] != len(times_s) - 1:
        keep.append(len(times_s) - 1)
    return Timed([times_s[k] for k in keep], positions[keep])


def _within(timed: Timed, speeds: Array) -> Timed:
    """Return the motion, slower if the curve through its waypoints exceeds a speed."""
    excess = max(
        _peak(timed.times_s.tolist(), column.tolist()) / limit
        for column, limit in zip(timed.positions.T, speeds.tolist(), strict=True)
    )
    return timed if excess <= 1.0 else Timed((timed.times_s * excess).tolist(), timed.positions)


def curve_places(timed: Timed) -> Iterator[tuple[float, Array]]:
    """Yield places on the curve through waypoints, which agents compute too, each after its time."""
    times, rows = timed.times_s, timed.positions
    speeds = np.array([waypoint_velocities(times.tolist(), column.tolist()) for column in rows.T]).T
    for k, (begin, end) in enumerate(pairwise(times.tolist())):
        for n in range(_SAMPLES):
            s, long_s = n / _SAMPLES, end - begin
            a, b = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2
            c, d = s * s * (3 - 2 * s), s * s * (s - 1)
            row = a * rows[k] + b * long_s * speeds[k] + c * rows[k + 1] + d * long_s * speeds[k + 1]
            yield begin + s * long_s, row
    yield timed.duration_s, rows[-1]


def _peak(times_s: Sequence[float], positions: Sequence[float]) -> float:
    """Return the highest speed of the curve through waypoints."""
    velocities = waypoint_velocities(times_s, positions)
    peak = 0.0
    for (t0, t1), (p0, p1), (v0, v1) in zip(pairwise(times_s), pairwise(positions), pairwise(velocities), strict=True):
        long_s = t1 - t0
        peak = max(peak, highest_speed(p1 - p0, v0 * long_s, v1 * long_s) / long_s)
    return peak
