"""The joint states that a driver uses, of all that arrive."""

import logging
import math

import pytest

from linked_fleet_agent.robot import RobotFaultError
from linked_fleet_agent.robots.ros2.cdr import JointState
from linked_fleet_agent.robots.ros2.joints import JointStates

UNKNOWN = math.nan


def said(stamp_ns: int = 0, **positions: float) -> JointState:
    count = len(positions)
    return JointState(
        stamp_ns, tuple(positions), tuple(positions.values()), tuple(range(1, count + 1)), (UNKNOWN,) * count
    )


@pytest.fixture
def states() -> JointStates:
    return JointStates("arm", ["a", "b"], "/joint_states", 0.5)


def test_joints_without_states_are_unknown_and_none_at_all_is_a_fault(states: JointStates) -> None:
    with pytest.raises(RobotFaultError, match=r"/joint_states for 0\.5 s"):
        states.reading(0.0)
    states.update(said(a=1.0), 0.0)
    reading = states.reading(0.5)
    assert reading.positions == pytest.approx((1.0, UNKNOWN), nan_ok=True)
    assert reading.velocities == pytest.approx((1.0, UNKNOWN), nan_ok=True)
    assert reading.efforts == pytest.approx((UNKNOWN, UNKNOWN), nan_ok=True)


def test_several_may_say_some_of_the_joints_and_each_grows_old_alone(states: JointStates) -> None:
    states.update(said(a=1.0), 0.0)
    states.update(said(b=2.0), 0.3)
    assert states.reading(0.4).positions == (1.0, 2.0)
    assert math.isnan(states.position("a", 0.6)) and states.position("b", 0.6) == 2.0
    with pytest.raises(RobotFaultError):
        states.reading(0.9)


def test_a_state_whose_time_stands_still_is_no_news(states: JointStates) -> None:
    for arrived_s in (0.0, 0.2, 0.4, 0.6):
        states.update(said(7, a=arrived_s), arrived_s)
    with pytest.raises(RobotFaultError):
        states.reading(0.7)
    states.update(said(6, a=1.0), 0.8)  # its clock was set back, but it is alive
    assert states.reading(0.9).positions[0] == 1.0


def test_a_position_that_is_no_number_is_unknown(states: JointStates) -> None:
    states.update(said(a=UNKNOWN, b=1.0), 0.0)
    assert states.reading(0.1).positions == pytest.approx((UNKNOWN, 1.0), nan_ok=True)


def test_joints_that_it_has_not_are_told_of_once(states: JointStates, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        for number in range(200):
            states.update(said(a=1.0, wheel=2.0), 0.0)
            states.update(said(**{f"x{number}": 2.0}), 0.0)
    assert len([record for record in caplog.records if "'wheel'" in record.message]) == 1
    assert len(caplog.records) == 64
    assert states.reading(0.1).positions[0] == 1.0
