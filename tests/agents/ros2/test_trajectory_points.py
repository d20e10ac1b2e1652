"""The points that are sent to a trajectory controller."""

import math

import pytest

from linked_fleet_agent.robots.ros2.joints import TrajectoryPoints, time_from_start_s


@pytest.fixture
def follower() -> TrajectoryPoints:
    return TrajectoryPoints("/c/joint_trajectory", ["a", "b"])


def test_a_point_has_the_setpoints_of_the_joints_of_its_controller(follower: TrajectoryPoints) -> None:
    assert follower.next({"b": 1.0, "c": 3.0, "a": 0.1}, 0.0) == {"a": 0.1, "b": 1.0}
    assert follower.next({"a": 0.1}, 0.1) == {"a": 0.1}


@pytest.mark.parametrize(
    ("measured", "now_s", "held"),
    [
        ({"a": 0.095, "b": 1.5}, 0.1, {"a": 0.1, "b": 2.0}),  # both were sent a moment ago
        ({"a": 9.0, "b": math.nan}, 0.1, {"a": 0.1, "b": 2.0}),  # no measurement becomes a command
        ({"a": 0.095, "b": 1.5}, 1.0, {"a": 0.1, "b": 1.5}),  # one sags, and the other was moved since
        ({"a": math.nan, "b": 1.5}, 1.0, {"b": 1.5}),
        ({"a": math.nan, "b": math.nan}, 1.0, {}),
    ],
)
def test_joints_are_held_where_they_were_sent_a_moment_ago_else_where_they_are(
    follower: TrajectoryPoints, measured: dict[str, float], now_s: float, held: dict[str, float]
) -> None:
    follower.next({"a": 0.1, "b": 2.0}, 0.0)
    assert follower.hold(measured, now_s) == held


def test_slow_agents_give_the_controller_more_time() -> None:
    assert [time_from_start_s(cycle_s) for cycle_s in (0.001, 0.01, 0.05, 0.1, 9.0)] == pytest.approx(
        [0.05, 0.05, 0.15, 0.3, 0.5]
    )
