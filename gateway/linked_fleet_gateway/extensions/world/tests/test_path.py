"""Points along a path are no further apart than stated."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_gateway.extensions.world.path import FINEST_M, STEP_M, Path, path_of
from linked_fleet_gateway.extensions.world.questions import paths_of
from linked_fleet_gateway.extensions.world.shapes import build_robot

MIMIC = "<mimic joint='a' multiplier='-2'/>"
ROBOT = build_robot(
    "<robot name='two'><link name='foot'/><link name='one'/><link name='two'/>"
    "<joint name='a' type='continuous'><parent link='foot'/><child link='one'/></joint>"
    f"<joint name='b' type='continuous'><parent link='one'/><child link='two'/>{MIMIC}</joint></robot>"
)
START = {"a": 0.2, "b": -0.4}
REACH = np.array([[0.05, 0.02]])  # m by which a pair comes closer per unit of each joint

steps = st.floats(0.01, 10)


def path(motion: Move | Follow) -> Path:
    (way,) = paths_of(motion, START, {})
    return path_of(ROBOT, way, ("a", "b"), REACH)


@given(st.lists(st.tuples(steps, st.floats(-1, 1)), min_size=1, max_size=4))
def test_places_of_a_trajectory_are_a_step_apart_at_most(points: list[tuple[float, float]]) -> None:
    times = tuple(np.cumsum([step for step, _ in points]).tolist())
    found = path(Follow(("a",), times, tuple((position,) for _, position in points)))
    assert _longest(found) <= STEP_M * (1 + 1e-9)
    for place in {0, found.steps // 2, found.steps - 1}:
        finer = found.between(place)
        assert finer.positions[[0, -1]] == pytest.approx(found.positions[place : place + 2])
        assert _longest(finer) <= FINEST_M * (1 + 1e-9)


def test_a_trajectory_that_leaves_a_waypoint_fast_has_no_longer_steps() -> None:
    """The cubic is almost three times as fast at its end as on average."""
    assert _longest(path(Follow(("a",), (10.0, 10.1), ((1.2,), (2.2,))))) <= STEP_M


def test_mimicking_joints_follow_between_samples() -> None:
    found = path(Move({"a": 1.2}))
    for place in range(0, found.steps, 7):
        a, b = found.between(place).positions.T
        assert b - START["b"] == pytest.approx(-2 * (a - START["a"]))


def _longest(found: Path) -> float:
    return float((np.diff(found.accumulated, axis=0) @ REACH.T).max(initial=0.0))
