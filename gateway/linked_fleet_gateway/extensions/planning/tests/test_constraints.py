"""Constraints of real arms on planned paths and straight lines, judged by the kinematics of Pinocchio alone."""

import math
from collections.abc import Iterator
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from msgspec.structs import replace

from linked_fleet_agent.robots.catalogue import MODELS, data_folder
from linked_fleet_gateway.extensions.planning.finder import find
from linked_fleet_gateway.extensions.planning.messages import (
    Broken,
    Constraints,
    FindPath,
    FindStraight,
    JointBounds,
    NotFound,
    PathFound,
    PlanAnswer,
    StraightFound,
)
from linked_fleet_gateway.extensions.planning.straight import find_straight
from linked_fleet_gateway.extensions.planning.timing import Timed, curve_places
from linked_fleet_gateway.extensions.world.messages import Check, MotionPath, PathSegment, Placement, Positions
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.shapes import build_robot
from linked_fleet_state.model import Pose

UPRIGHT_RAD, WIDE_RAD = math.radians(15), math.radians(25)
TURNED = Pose((0.3, -0.2, 0.1), (0.0, 0.0, math.sin(0.4), math.cos(0.4)))
"""The placement of the arms: a constraint is one of the world, not of the base."""
TIPS = {"panda": ("panda_hand", "-z"), "ur5": ("ee_link", "x")}


class Arm:
    """A real arm without its shapes, and its kinematics."""

    def __init__(self, name: str) -> None:
        urdf = (data_folder() / MODELS[name].file).read_text()
        self.name, (self.tip, self.axis) = name, TIPS[name]
        self.robot: Robot = build_robot(urdf)
        self._model = pin.buildModelFromXML(urdf)
        self._data = self._model.createData()
        self.joints = [each for each in self._model.names if each != "universe" and "finger" not in each]
        self.home = {each: MODELS[name].home.get(each, 0.0) for each in self._model.names if each != "universe"}
        self._base = pin.XYZQUATToSE3(np.array((*TURNED.position_m, *TURNED.orientation_xyzw)))

    def pose(self, place: Positions) -> pin.SE3:
        q = pin.neutral(self._model)
        for joint, value in (self.home | place).items():
            q[self._model.joints[self._model.getJointId(joint)].idx_q] = value
        pin.framesForwardKinematics(self._model, self._data, q)
        return self._base * self._data.oMf[self._model.getFrameId(self.tip)]

    def tilt(self, place: Positions) -> float:
        up = self.pose(place).rotation @ np.eye(3)["xyz".index(self.axis[-1])] * (-1.0 if "-" in self.axis else 1.0)
        return float(np.arccos(np.clip(up[2], -1.0, 1.0)))

    def somewhere(self, chance: np.random.Generator, most_rad: float) -> Positions:
        """Return positions within the limits in which the tip is upright."""
        while True:
            found = {name: float(chance.uniform(-2.5, 2.5)) for name in self.joints}
            low, high = self._model.lowerPositionLimit, self._model.upperPositionLimit
            found = {n: float(np.clip(v, low[k] + 0.05, high[k] - 0.05)) for k, (n, v) in enumerate(found.items())}
            if self.tilt(found) <= most_rad:
                return found

    def asked(self, start: Positions, goal: Positions, keeps: Constraints, seed: int = 1) -> FindPath:
        path = MotionPath(self.home | start, (PathSegment(goal),))
        around = Check(Placement(self.name, self.name, TURNED), (path,), (), (), 10.0)
        bounds = {name: JointBounds(-3.1, 3.1, 1.5, 3.75) for name in self.joints}
        return FindPath(around, bounds, (goal,), 10.0, seed, keeps)

    def find(self, start: Positions, goal: Positions, keeps: Constraints) -> PlanAnswer:
        return find(self.asked(start, goal, keeps), {self.name: self.robot}, {}, {})

    def line(self, start: Positions, goal: Positions, keeps: Constraints) -> PlanAnswer:
        asked = self.asked(start, goal, keeps)
        return find_straight(FindStraight(asked.around, asked.bounds, self.tip, goal, True, False, keeps), self.robot)

    def along(self, start: Positions, found: PathFound | StraightFound) -> Iterator[tuple[float, Positions]]:
        """Yield the places of the curve that the agent follows, with their times."""
        rows = np.array([[start[name] for name in found.joints], *found.positions])
        for time_s, row in curve_places(Timed((0.0, *found.times_s), rows)):
            yield time_s, dict(zip(found.joints, row.tolist(), strict=True))


@cache
def arm(name: str) -> Arm:
    return Arm(name)


def ends(it: Arm, seed: int) -> tuple[Positions, Positions]:
    chance = np.random.default_rng(seed)
    return it.somewhere(chance, UPRIGHT_RAD), it.somewhere(chance, UPRIGHT_RAD)


CASES = [("panda", 2), ("panda", 3), ("panda", 7), ("ur5", 4)]


@pytest.mark.parametrize(("name", "seed"), CASES)
def test_the_tip_stays_upright(name: str, seed: int) -> None:
    """On the way that the hand of Panda takes without the constraint it does not."""
    it = arm(name)
    start, goal = ends(it, seed)
    free = it.find(start, goal, Constraints(it.tip))
    assert isinstance(free, PathFound)
    assert name == "ur5" or max(it.tilt(place) for _, place in it.along(start, free)) > WIDE_RAD
    found = it.find(start, goal, Constraints(it.tip, upright=WIDE_RAD, axis=it.axis))
    assert isinstance(found, PathFound), found
    assert max(it.tilt(place) for _, place in it.along(start, found)) <= WIDE_RAD
    assert dict(zip(found.joints, found.positions[-1], strict=True)) == pytest.approx(goal, abs=1e-6)


def test_a_way_that_there_is_not_is_not_found() -> None:
    """The flange of a UR5 cannot turn its wrist over while it is upright."""
    it = arm("ur5")
    start, goal = ends(it, 1)
    asked = it.asked(start, goal, Constraints(it.tip, upright=WIDE_RAD, axis=it.axis))
    assert isinstance(find(replace(asked, within_s=0.5), {it.name: it.robot}, {}, {}), NotFound)


@pytest.mark.parametrize(("name", "seed"), CASES)
def test_the_tip_stays_in_a_box(name: str, seed: int) -> None:
    it = arm(name)
    start, goal = ends(it, seed)
    one, other = (it.pose(each).translation for each in (start, goal))
    low, high = np.minimum(one, other) - 0.15, np.maximum(one, other) + 0.15
    box = (tuple(low.tolist()), tuple(high.tolist()))
    found = it.find(start, goal, Constraints(it.tip, stay_in=box))
    assert isinstance(found, PathFound | NotFound), found
    if isinstance(found, PathFound):
        places = np.array([it.pose(place).translation for _, place in it.along(start, found)])
        assert (places >= low - 1e-6).all() and (places <= high + 1e-6).all()


@pytest.mark.parametrize(("name", "seed"), CASES)
def test_the_tip_is_never_faster(name: str, seed: int) -> None:
    it, most = arm(name), 0.1
    start, goal = ends(it, seed)
    found = it.find(start, goal, Constraints(it.tip, tip_speed=most))
    assert isinstance(found, PathFound)
    times, places = zip(*((t, it.pose(place).translation) for t, place in it.along(start, found)), strict=True)
    speeds = np.linalg.norm(np.diff(np.array(places), axis=0), axis=1) / np.diff(times)
    assert 0.9 * most <= float(speeds.max()) <= most


def manipulability(it: Arm, place: Positions, joints: tuple[str, ...]) -> float:
    """Return the product of the singular values of a Jacobian by finite differences."""
    step, here = 1e-6, it.pose(place)
    columns = [pin.log6(here.actInv(it.pose(place | {name: place[name] + step}))).vector / step for name in joints]
    return float(np.prod(np.linalg.svd(np.array(columns), compute_uv=False)))


@pytest.mark.parametrize(("name", "seed"), CASES)
def test_the_least_manipulability_is_told_and_kept_to(name: str, seed: int) -> None:
    it = arm(name)
    start, goal = ends(it, seed)
    found = it.find(start, goal, Constraints(it.tip))
    assert isinstance(found, PathFound) and found.least is not None
    places = [start, *(dict(zip(found.joints, row, strict=True)) for row in found.positions)]
    seen = [manipulability(it, place, found.joints) for place in places]
    assert found.least.value == pytest.approx(min(seen), rel=0.01, abs=1e-5)
    at_ends = min(seen[0], seen[-1])
    better = it.find(start, goal, Constraints(it.tip, least_manipulability=0.9 * at_ends))
    if isinstance(better, PathFound):
        assert better.least is not None and better.least.value >= 0.9 * at_ends - 1e-5
    refused = it.find(start, goal, Constraints(it.tip, least_manipulability=2 * at_ends))
    assert isinstance(refused, Broken) and refused.kind == "leastManipulability" and refused.share in {0.0, 1.0}


def test_what_is_not_kept_to_at_the_ends_is_refused_with_numbers() -> None:
    it = arm("ur5")
    start, goal = ends(it, 1)
    tilted = goal | {"wrist_1_joint": goal["wrist_1_joint"] + 0.8}
    keeps = Constraints(it.tip, upright=WIDE_RAD, axis=it.axis)
    for one, other, share, at in ((start, tilted, 1.0, tilted), (tilted, goal, 0.0, tilted)):
        refused = it.find(one, other, keeps)
        assert isinstance(refused, Broken)
        assert (refused.kind, refused.share, refused.limit) == ("upright", share, WIDE_RAD)
        assert refused.value == pytest.approx(it.tilt(at), abs=1e-6)
    outside = it.find(start, goal, Constraints(it.tip, stay_in=((5.0, -9.0, -9.0), (6.0, 9.0, 9.0))))
    assert isinstance(outside, Broken) and (outside.kind, outside.axis, outside.limit) == ("stayIn", "x", 5.0)
    assert outside.value == pytest.approx(it.pose(start).translation[0])


def test_a_straight_line_keeps_to_constraints_or_says_where_it_does_not() -> None:
    it = arm("ur5")
    start = {name: it.home[name] for name in it.joints}
    goal = start | {"shoulder_pan_joint": start["shoulder_pan_joint"] + 0.3, "wrist_3_joint": start["wrist_3_joint"]}
    plain = it.line(start, goal, Constraints(it.tip, tip_speed=0.02))
    assert isinstance(plain, StraightFound) and plain.least is not None
    one, other = it.pose(start).translation, it.pose(goal).translation
    assert plain.times_s[-1] > float(np.linalg.norm(other - one)) / 0.02
    low, high = np.minimum(one, other) - 0.01, np.maximum(one, other) + 0.01
    middle = (one + other) / 2
    far = int(np.argmax(np.abs(other - one)))
    low[far], high[far] = sorted((one[far] - 0.05 * np.sign(other[far] - one[far]), middle[far]))
    refused = it.line(start, goal, Constraints(it.tip, stay_in=(tuple(low.tolist()), tuple(high.tolist()))))
    assert isinstance(refused, Broken) and refused.kind == "stayIn" and 0.3 < refused.share < 0.7
    assert refused.axis == "xyz"[far]
