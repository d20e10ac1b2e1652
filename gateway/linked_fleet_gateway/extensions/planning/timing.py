"""The fastest motion along a path of corners: TOPP-RA within speeds and accelerations. Radian, metre, second.

Corners are rounded as far as the rounded path is free. The waypoints are as dense as a command takes, so that the
curve through them, which agents and the collision check compute, stays next to the path.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from roboplan.core import JointPath, JointTrajectory, Scene
from roboplan.toppra import PathParameterizerTOPPRA, SplineFittingMode, TOPPRAOptions

from linked_fleet_gateway.extensions.world.path import highest_speed
from linked_fleet_gateway.extensions.world.questions import waypoint_velocities
from linked_fleet_gateway.extensions.world.surfaces import Array

STEP_S, FINE_STEP_S = 0.03, 0.01
SMOOTHING_S = 0.06
"""Positions are averaged over this time, so that a joint takes at least half of it to its full acceleration."""
MOST_WAYPOINTS, MOST_POSITIONS = 1_000, 16_384
"""The most that one command of an agent may have."""
_ROUNDINGS = (0.3, 0.1)
_SHARE = 0.98
"""Share of the speed limits, so that the curve through the waypoints stays within them."""
_SHORTEST_S = 0.005
_LONGEST_S = 3_600.0
"""Numerical trouble gives some curves a motion of weeks, whose samples would fill the memory."""
_WHOLE_S = 1e15
"""A step in which every motion fits, so that nothing but its duration is computed."""
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
    return _Curve(scene, path, SplineFittingMode.Hermite).duration_s


def fastest(
    scene: Scene,
    path: JointPath,
    speeds: Array,
    accepts: Callable[[Timed], bool] = lambda timed: True,
    refined: JointPath | None = None,
) -> Timed | None:
    """Return the fastest motion along a path, or along one that was ``refined`` from it, that is accepted, or None.

    ``speeds`` are the limits of its joints, in order.
    """
    curves = _curves(scene, path, (0.0, *_ROUNDINGS) if refined is None else (0.0, _ROUNDINGS[0]))
    if refined is not None:
        curves += _curves(scene, refined, (0.0, _ROUNDINGS[-1]))
    best: Timed | None = None
    for curve in sorted(curves, key=lambda each: each.duration_s or math.inf):
        if best is not None and best.duration_s <= (curve.duration_s or math.inf):
            break
        timed = _within(_smoothed(curve.timed(FINE_STEP_S), STEP_S, SMOOTHING_S), speeds)
        if (best is None or timed.duration_s < best.duration_s) and accepts(timed):
            best = timed
    return best


def _curves(scene: Scene, path: JointPath, roundings: Sequence[float]) -> "list[_Curve]":
    """Return the curves through a path that have a motion: a spline (0), and with corners that are rounded so far."""
    found = [
        _Curve(scene, path, SplineFittingMode.LinearBlend if rounding else SplineFittingMode.Cubic, rounding)
        for rounding in roundings
        if rounding or len(path.positions) > 2
    ]
    return [each for each in found if each.duration_s is not None]


def smooth(scene: Scene, path: JointPath, speeds: Array) -> Timed | None:
    """Return the fastest motion along a path of many places near each other, or None."""
    if len(path.positions) == 1:
        return None
    curve = _Curve(scene, path, SplineFittingMode.Cubic)
    if curve.duration_s is None:
        return None
    return _within(_smoothed(curve.timed(FINE_STEP_S), FINE_STEP_S, SMOOTHING_S), speeds)


class _Curve:
    """A curve through a path and its fastest motion; ``duration_s`` is None if numerical trouble leaves it without."""

    def __init__(self, scene: Scene, path: JointPath, mode: SplineFittingMode, rounding: float | None = None) -> None:
        self._parameterizer, self._path = PathParameterizerTOPPRA(scene), path
        self._options = TOPPRAOptions(mode=mode, velocity_scale=_SHARE)
        if rounding is not None:
            self._options.max_blend_deviation = rounding
        self.duration_s = self._duration_s()

    def _duration_s(self) -> float | None:
        try:
            times = self._motion(_WHOLE_S).times
        except (RuntimeError, ValueError):  # also for places that are the same
            return None
        return float(times[-1]) if len(times) >= 2 and times[-1] <= _LONGEST_S else None

    def _motion(self, step_s: float) -> JointTrajectory:
        self._options.dt = step_s
        return self._parameterizer.generate(self._path, self._options)

    def timed(self, step_s: float) -> Timed:
        """Return the motion, if there is one."""
        found = self._motion(step_s)
        return _thinned(found.times, np.array(found.positions))


def _smoothed(timed: Timed, step_s: float, over_s: float) -> Timed:
    """Return the motion with positions averaged over a time, by which it ends later, at steps.

    No speed and no acceleration is larger than before. An acceleration a changes by 2 a in this time at most, and a
    position by a / 24 times its square.
    """
    ends_s = timed.duration_s + over_s
    at_s = np.linspace(0.0, ends_s, max(1, round(ends_s / step_s)) + 1)
    found = (_integral(timed, at_s) - _integral(timed, at_s - over_s)) / over_s
    found[0], found[-1] = timed.positions[0], timed.positions[-1]
    return _thinned(at_s.tolist(), found)


def _integral(timed: Timed, at_s: Array) -> Array:
    """Return the integrals of the positions from the start of a motion, before and after which they stay."""
    times, rows = timed.times_s, timed.positions
    pieces = np.diff(times)[:, None] * (rows[1:] + rows[:-1]) / 2
    whole = np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(pieces, axis=0)])
    inside = np.clip(at_s, 0.0, timed.duration_s)
    k = np.clip(np.searchsorted(times, inside, "right") - 1, 0, len(times) - 2)
    since_s = inside - times[k]
    middle = rows[k] + (rows[k + 1] - rows[k]) * (since_s / (times[k + 1] - times[k]))[:, None] / 2
    before, after = np.minimum(at_s, 0.0), np.maximum(at_s - timed.duration_s, 0.0)
    found: Array = whole[k] + since_s[:, None] * middle + before[:, None] * rows[0] + after[:, None] * rows[-1]
    return found


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
