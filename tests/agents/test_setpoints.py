"""The last setpoints of joints, which follow what moves the joints and are followed by what is sent."""

import logging
import math

import pytest

from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.setpoints import Setpoints, rate_of

ARM = JointFacts("arm", limits=Limits(-3.0, 3.0, 1.0))
WHEEL = JointFacts("wheel", continuous=True, limits=Limits(velocity=2.0))
DT = 0.01


def followed(joint: JointFacts, *measured: float, driven: bool = False) -> list[float]:
    """Return the setpoint after each measured position."""
    setpoints, found = Setpoints([joint]), []
    for position in measured:
        setpoints.follow([position], {joint.name} if driven else (), DT)
        found.append(setpoints[joint.name])
    return found


@pytest.mark.parametrize(
    ("joint", "measured", "expected"),
    [
        (ARM, [0.5, 0.505, 0.495], [0.5, 0.5, 0.5]),  # it sags, or its sensor has noise
        (ARM, [0.5, 0.508, 0.515, 0.518, 0.516], [0.5, 0.5, 0.51, 0.518, 0.516]),  # something moves it
        (ARM, [0.5, 1.5, 1.5, 0.5], [0.5, 0.51, 0.52, 0.51]),  # no jump becomes a setpoint
        (ARM, [math.nan, 0.5, math.nan, 0.5], [math.nan, 0.5, 0.5, 0.5]),
        (WHEEL, [3.13, -3.13, -3.11], [3.13, 3.15, 3.17]),  # it shows angles within a turn
        (WHEEL, [0.0, 3.0, -3.0], [0.0, 0.02, 0.0]),  # the nearest way
    ],
)
def test_setpoints_follow_what_moves_the_joint_at_its_speed(
    joint: JointFacts, measured: list[float], expected: list[float]
) -> None:
    assert followed(joint, *measured) == pytest.approx(expected, abs=4e-3 if joint is WHEEL else 1e-9, nan_ok=True)


def test_setpoints_of_joints_that_are_driven_follow_nothing() -> None:
    assert followed(ARM, 0.5, 0.6, 0.7, driven=True) == [0.5, 0.5, 0.5]


def test_a_joint_that_something_else_is_told_to_move_is_followed_over_short_ways_too() -> None:
    setpoints = Setpoints([ARM])
    found = []
    for position in (0.5, 0.5, 0.495, 0.4951):
        setpoints.follow([position], (), DT)
        setpoints.release(["arm", "another"])
        found.append(setpoints["arm"])
    assert found == [0.5, 0.5, 0.495, 0.4951]
    setpoints.adopt({"arm": 0.4951})
    setpoints.follow([0.496], (), DT)
    assert setpoints["arm"] == 0.4951


def test_a_joint_that_was_driven_again_may_sag_again() -> None:
    setpoints = Setpoints([ARM])
    for position in (0.0, 0.02, 0.02, 0.02):
        setpoints.follow([position], (), DT)
    setpoints.adopt({"arm": 0.02})
    setpoints.follow([0.015], (), DT)
    assert setpoints["arm"] == 0.02


@pytest.mark.parametrize(
    ("wanted", "sent"), [(0.505, 0.505), (0.51, 0.51), (0.6, 0.51), (-9.0, 0.49), (0.49, 0.49), (0.5, 0.5)]
)
def test_no_setpoint_is_further_than_speed_and_time_allow(wanted: float, sent: float) -> None:
    setpoints = Setpoints([ARM])
    setpoints.follow([0.5], (), DT)
    assert setpoints.limit({"arm": wanted}, DT) == {"arm": pytest.approx(sent)}


def test_a_setpoint_that_had_to_be_limited_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    setpoints = Setpoints([ARM])
    setpoints.follow([0.5], (), DT)
    with caplog.at_level(logging.ERROR):
        for _ in range(3):
            setpoints.limit({"arm": 2.0}, DT)
    assert len(caplog.records) == 1
    assert "a setpoint of arm was 1.5 from the one before" in caplog.text


@pytest.mark.parametrize(
    ("joint", "rate"),
    [
        (ARM, 1.0),
        (JointFacts("a"), 1.5),
        (JointFacts("a", linear=True), 0.25),
        (JointFacts("a", limits=Limits(velocity=1.797e308)), 100.0),
    ],
)
def test_the_rate_is_that_of_the_urdf_or_an_assumed_one(joint: JointFacts, rate: float) -> None:
    assert rate_of(joint) == rate
