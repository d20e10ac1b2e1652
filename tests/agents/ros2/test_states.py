"""The joint states that a driver uses, of all that arrive."""

import logging
import math

import pytest

from linked_fleet_agent.robot import JointFacts, Limits, RobotFaultError
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
    joints = [JointFacts(name, limits=Limits(velocity=3.0)) for name in ("a", "b")]
    return JointStates("arm", joints, "/joint_states", 0.5)


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


def test_a_repeated_state_is_no_news(states: JointStates) -> None:
    """A relay may send the last message again and again. If all stamps are equal, the publisher has no clock."""
    states.update(said(6, a=0.0), 0.0)
    for arrived_s in (0.0, 0.2, 0.4, 0.6):
        states.update(said(7, a=0.0), arrived_s)
    with pytest.raises(RobotFaultError):
        states.reading(0.7)
    states.update(said(6, a=1.0), 0.8)  # its clock was set back, but it is alive
    assert states.reading(0.9).positions[0] == 1.0


@pytest.mark.parametrize("stamp_ns", [0, 7])
def test_states_with_a_constant_stamp_count_as_they_arrive(states: JointStates, stamp_ns: int) -> None:
    for arrived_s in (0.0, 0.2, 0.4, 0.6):
        states.update(said(stamp_ns, a=arrived_s), arrived_s)
    assert states.reading(0.7).positions[0] == 0.6
    assert states.reading(0.7).measured_s[0] == 0.6


@pytest.mark.parametrize(
    "positions",
    [
        [0.8, 0.8, 0.0, 0.8, 0.0, 0.8],  # a second publisher, of zeros
        [0.8, 0.8, 1.9, 1.9, 0.8, 0.8],  # an outlier of two messages
        [3.1, 3.14, -3.13, -3.12, -3.1, -3.1],  # the seam of an encoder
    ],
)
def test_a_joint_whose_states_contradict_each_other_is_unknown(states: JointStates, positions: list[float]) -> None:
    """Also if the agent reads only one of several messages. The other joint stays known."""
    for number, position in enumerate(positions):
        states.update(said(number + 1, a=position, b=0.1), number * 0.01)
    reading = states.reading(0.06)
    assert math.isnan(reading.positions[0])
    assert reading.positions[1] == 0.1
    assert list(reading.faults) == ["a"]
    assert "contradicts itself" in reading.faults["a"]
    for number in range(120):
        states.update(said(number + 10, a=positions[-1], b=0.1), 0.06 + number * 0.01)
    assert states.reading(1.3).positions == (positions[-1], 0.1)
    assert not states.reading(1.3).faults


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
