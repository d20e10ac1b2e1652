"""The timing of paths that give TOPP-RA numerical trouble: it ends, and takes no memory."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from roboplan.core import JointPath

from linked_fleet_gateway.extensions.planning.planner_scene import SceneWriter
from linked_fleet_gateway.extensions.planning.tests.arms import ACCELERATION, ARM, BOUNDS, JOINTS, SPEED, STRETCHED
from linked_fleet_gateway.extensions.planning.timing import SMOOTHING_S, fastest, quickly_timed_s, smooth

PLACES = (
    -2.19, -2.17, -2.14, -2.11, -2.07, -2.03, -1.98, -1.93, -1.88, -1.84, -1.75, -1.7, -1.66, -1.62, -1.58, -1.54, -1.5,
    -1.38, -1.34, -1.31, -1.27, -1.23, -1.2, -1.16, -1.12, -1.09, -1.05, -1.01, -0.98, -0.91, -0.87, -0.84, -0.8, -0.7,
    -0.66, -0.63, -0.59, -0.53, -0.49, -0.27, -0.22, -0.17, -0.12, -0.07, -0.02, 0.04, 0.09, 0.15, 0.33, 0.39, 1.2,
)  # fmt: skip
"""Positions of a joint on a path that a search has found. The cubic spline through them has a motion of nine months."""
FEW_BYTES = 2**30


@contextmanager
def few_bytes() -> Iterator[None]:
    """Bound what this process may take in addition, so that a test that needs more fails alone."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + FEW_BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def test_jerk_is_bounded_with_speed_and_acceleration(tmp_path: Path) -> None:
    """Also where a corner is rounded, and at both ends, before and after which the joints stand."""
    made = SceneWriter(ARM, STRETCHED, BOUNDS, tmp_path).build_bare()
    path = JointPath()
    path.joint_names = made.scene.getJointNames()
    path.positions = [np.array(row) for row in ((0.0, 0.0, 0.0), (1.5, 0.3, 0.0), (1.5, -1.2, 0.8), (0.2, -1.2, 2.0))]
    found = fastest(made.scene, path, np.full(len(JOINTS), SPEED))
    assert found is not None
    step_s = found.times_s[1] - found.times_s[0]
    assert np.diff(found.times_s) == pytest.approx(step_s)
    rows = np.concatenate([found.positions[:1]] * 3 + [found.positions] + [found.positions[-1:]] * 3)
    speed, acceleration, jerk = (np.abs(np.diff(rows, n, axis=0)).max() / step_s**n for n in (1, 2, 3))
    assert 0.9 * SPEED < speed <= SPEED
    assert 0.9 * ACCELERATION < acceleration <= 1.02 * ACCELERATION
    assert jerk <= 1.05 * 2 * ACCELERATION / SMOOTHING_S


def test_a_curve_that_takes_months_is_none(tmp_path: Path) -> None:
    made = SceneWriter(ARM, STRETCHED, BOUNDS, tmp_path).build_bare()
    rows = np.zeros((len(PLACES), len(JOINTS)))
    rows[:, 1] = PLACES
    path, speeds = JointPath(), np.full(len(JOINTS), SPEED)
    path.joint_names, path.positions = made.scene.getJointNames(), list(rows)
    with few_bytes():
        assert smooth(made.scene, path, speeds) is None
        found, with_stops_s = fastest(made.scene, path, speeds), quickly_timed_s(made.scene, path)
    assert found is not None
    assert found.positions[-1] == pytest.approx(rows[-1])
    assert with_stops_s is not None
    least_s = (PLACES[-1] - PLACES[0]) / SPEED
    assert least_s < found.duration_s <= with_stops_s * 1.01 + SMOOTHING_S
