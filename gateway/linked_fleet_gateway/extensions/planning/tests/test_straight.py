"""Straight lines of a link."""

import math

import numpy as np
import pinocchio as pin
import pytest

from linked_fleet_gateway.extensions.planning.messages import LineEnds, StraightFound
from linked_fleet_gateway.extensions.planning.straight import MOST_OFF_M, MOST_OFF_RAD, find_straight
from linked_fleet_gateway.extensions.planning.tests.arms import ARM, JOINTS, LENGTH_M, Room, joints
from linked_fleet_gateway.extensions.world.surfaces import Array

BENT = joints(0.6, -1.2, 0.4)


def tip(positions: Array) -> Array:
    """Return the place of the tip of the planar arm by plain trigonometry."""
    angles = np.cumsum(positions)
    return LENGTH_M * np.array([np.cos(angles).sum(), np.sin(angles).sum()])


def places(found: StraightFound, start: dict[str, float]) -> Array:
    order = [found.joints.index(name) for name in JOINTS]
    return np.array([tip(np.array(row)[order]) for row in (tuple(start[n] for n in found.joints), *found.positions)])


@pytest.mark.parametrize("goal", [joints(0.9, -1.6, 0.5), joints(0.3, -0.9, 0.9), joints(0.6, -1.2, -0.6)])
def test_the_tip_stays_on_the_line(goal: dict[str, float]) -> None:
    found = find_straight(Room().line(BENT, goal, exact=False), ARM)
    assert isinstance(found, StraightFound), found
    seen = places(found, BENT)
    start, way = seen[0], seen[-1] - seen[0]
    assert seen[-1] == pytest.approx(tip(np.array([goal[name] for name in JOINTS])), abs=1e-4)
    if np.linalg.norm(way) > 0.01:
        across = np.array([-way[1], way[0]]) / np.linalg.norm(way)
        assert np.abs((seen - start) @ across).max() <= MOST_OFF_M
    assert found.off_m <= MOST_OFF_M and found.off_rad <= MOST_OFF_RAD


def test_the_orientation_turns_evenly() -> None:
    goal = joints(0.9, -1.6, 0.5)
    found = find_straight(Room().line(BENT, goal), ARM)
    assert isinstance(found, StraightFound)
    seen, turns = places(found, BENT), np.array([sum(row) for row in found.positions])
    shares = np.linalg.norm(seen[1:] - seen[0], axis=1) / np.linalg.norm(seen[-1] - seen[0])
    even = sum(BENT.values()) + shares * (sum(goal.values()) - sum(BENT.values()))
    assert np.abs(turns - even).max() <= MOST_OFF_RAD


def test_a_line_through_the_shoulder_ends_before_it() -> None:
    """The arm cannot fold onto itself, and would have to jump to reach out to the other side."""
    found = find_straight(Room().line(joints(0.3, -0.5, 0.2), joints(0.3 + 2.6, -0.5, 0.2), exact=False), ARM)
    assert isinstance(found, LineEnds)
    assert 0.0 < found.share < 1.0 and found.why


def test_a_line_that_ends_in_another_posture_is_none() -> None:
    """With the elbow on the other side the tip is at the same place."""
    folded = joints(0.6, -1.2, 0.6)
    mirrored = joints(0.6 - 1.2, 1.2, -0.6)
    assert tip(np.array(list(folded.values()))) == pytest.approx(tip(np.array(list(mirrored.values()))), abs=0.4)
    found = find_straight(Room().line(folded, mirrored), ARM)
    assert isinstance(found, LineEnds)


def test_the_frame_of_the_line_is_that_of_the_link() -> None:
    goal = joints(0.9, -1.6, 0.5)
    found = find_straight(Room().line(BENT, goal), ARM)
    assert isinstance(found, StraightFound)
    model, data = ARM.model, ARM.model.createData()
    q = pin.neutral(model)
    for name, position in zip(found.joints, found.positions[-1], strict=True):
        q[model.joints[model.getJointId(name)].idx_q] = position
    pin.framesForwardKinematics(model, data, q)
    at = data.oMf[model.getFrameId("tip", pin.FrameType.BODY)]
    assert math.hypot(*at.translation[:2]) == pytest.approx(float(np.linalg.norm(places(found, BENT)[-1])), abs=1e-6)
