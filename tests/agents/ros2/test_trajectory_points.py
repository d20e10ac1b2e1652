"""The points that are sent to a trajectory controller."""

import math

import pytest

from linked_fleet_agent.robots.ros2.joints import TrajectoryPoints, time_from_start_s


@pytest.fixture
def follower() -> TrajectoryPoints:
    return TrajectoryPoints("/c/joint_trajectory", ["a", "b"])


def test_all_joints_of_the_controller_are_in_it_and_those_that_are_told_nothing_stay(
    follower: TrajectoryPoints,
) -> None:
    assert follower.next({"a": 0.1}, {"a": 0.0, "b": 1.0}, 0.0) == {"a": 0.1, "b": 1.0}
    assert follower.next({"a": 0.2}, {"a": 0.1, "b": 0.95}, 0.01) == {"a": 0.2, "b": 1.0}  # it sags, but is not let go


def test_joints_moved_by_others_in_a_pause_stay(follower: TrajectoryPoints) -> None:
    follower.next({"a": 0.1}, {"a": 0.0, "b": 1.0}, 0.0)
    assert follower.next({"a": 0.2}, {"a": 0.1, "b": 2.0}, 0.6) == {"a": 0.2, "b": 2.0}
    assert follower.next({"a": 0.3}, {"a": 0.2, "b": 2.005}, 1.2) == {
        "a": 0.3,
        "b": 2.0,
    }  # what it holds it continues to hold


def test_joints_with_unknown_positions_are_left_out(follower: TrajectoryPoints) -> None:
    assert follower.next({"a": 0.1}, {"a": 0.0, "b": math.nan}, 0.0) == {"a": 0.1}
    assert follower.next({"a": 0.1}, {"a": 0.0, "b": 1.0}, 0.1) == {"a": 0.1, "b": 1.0}
    assert follower.hold({"a": math.nan, "b": math.nan}, 0.2) == {}


def test_holding_is_where_it_is_or_where_it_was_sent_if_it_is_there(follower: TrajectoryPoints) -> None:
    follower.next({"a": 0.1, "b": 2.0}, {"a": 0.0, "b": 1.0}, 0.0)
    assert follower.hold({"a": 0.095, "b": 1.5}, 0.1) == {"a": 0.1, "b": 1.5}
    assert follower.hold({"a": 0.094, "b": 1.495}, 0.2) == {"a": 0.1, "b": 1.5}


def test_slow_agents_give_the_controller_more_time() -> None:
    assert [time_from_start_s(cycle_s) for cycle_s in (0.001, 0.01, 0.05, 0.1, 9.0)] == pytest.approx(
        [0.05, 0.05, 0.15, 0.3, 0.5]
    )
