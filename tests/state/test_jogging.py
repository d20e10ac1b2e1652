"""The ways of joints that are jogged."""

import pytest

from linked_fleet_state.driving import REACTION_S
from linked_fleet_state.jogging import JointDrive

LIFT = JointDrive({"lift": 1.0}, 0.5, {"turn": 10.0, "lift": 10.0})


def test_joints_may_brake_before_a_late_request_reaches_them() -> None:
    braking = [way for way in LIFT.ways({"turn": 1.0}) if any(at["lift"] == 0.0 and at["turn"] > 0.045 for at in way)]
    assert min(way[-1]["turn"] for way in braking) == pytest.approx(0.05, abs=0.01)


def test_joints_may_go_on_and_go_towards_an_earlier_request_before_a_late_one_reaches_them() -> None:
    ends = [way[-1] for way in LIFT.ways({"turn": 1.0}, {"turn": -1.0})]
    assert max(each["turn"] for each in ends) > REACTION_S
    assert min(each["turn"] for each in ends) < 0.05


def test_of_ways_on_one_line_there_is_one() -> None:
    assert len(LIFT.ways({"lift": 0.5}, {"lift": 0.2})) == 1
