"""What an agent tells of its robot, and what it refuses to tell because gateways would refuse it."""

import logging
import math
from dataclasses import replace

import pytest

from descriptions_of_robots import LIMIT, arm, described
from linked_fleet_agent.publications import describe
from linked_fleet_agent.robot import Facts, JointFacts
from linked_fleet_agent.urdf import UrdfError, joints_of


def _facts(urdf: str) -> Facts:
    return Facts("R", urdf, joints_of(urdf))


@pytest.mark.parametrize(
    "facts",
    [
        replace(_facts(arm()), urdf=arm(attributes=' version="2.0"')),
        replace(_facts(arm()), joints=(JointFacts("j1"), JointFacts("j1"))),
        replace(_facts(arm()), joints=(JointFacts("j1"), JointFacts("j3"))),
        replace(_facts(arm()), urdf=arm().replace('"j2" type="revolute"', '"j2" type="fixed"')),
    ],
    ids=["version", "a joint twice", "an absent joint", "a joint that does not move"],
)
def test_a_description_that_gateways_would_refuse_is_refused_by_its_agent_with_their_words(facts: Facts) -> None:
    by_gateway = described(facts.urdf, tuple(joint.name for joint in facts.joints)).fault
    with pytest.raises(UrdfError) as refused:
        describe("r", 1, facts, 100.0, (), ())
    assert str(refused.value) == by_gateway


@pytest.mark.parametrize("tolerance", [0.0, -0.1, 1.1, math.nan])
def test_a_tolerance_that_gateways_would_refuse_is_refused_by_the_agent(tolerance: float) -> None:
    facts = _facts(arm())
    first, *others = facts.joints
    with pytest.raises(UrdfError, match=f"joint 'j1' has a tolerance of {tolerance:g} rad; it must be above 0 and at"):
        describe("r", 1, replace(facts, joints=(replace(first, tolerance=tolerance), *others)), 100.0, (), ())


def test_findings_are_logged_when_the_agent_starts(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        describe("r", 1, _facts(arm(LIMIT.replace('upper="1.5"', 'upper="-2"'))), 100.0, (), ())
    assert caplog.messages == [
        "r: Joint 'j1' can be held but not moved: the lower limit of joint 'j1', -1.5, is above its upper limit, -2.0."
    ]
