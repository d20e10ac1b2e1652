"""Joint positions that bring a link to a pose: five real robots, small ones computed by hand, and hostile numbers."""

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from linked_fleet_agent.robots.catalogue import MODELS, data_folder
from linked_fleet_agent.wire.messages import Base
from linked_fleet_gateway.extensions.reach.inverse_kinematics import (
    MAX_ITERATIONS,
    TOLERANCE_M,
    TOLERANCE_RAD,
    Solution,
    Unreachable,
    reach,
)
from linked_fleet_state.kinematics import ORIGIN, LinkPoses, base_pose
from linked_fleet_state.model import ModelError, Pose, RobotModel
from properties import examples

CASES = [
    ("baxter", "left_gripper", True),
    ("baxter", "right_gripper", True),
    ("ur5", "ee_link", True),
    ("ur5", "wrist_3_link", True),
    ("panda", "panda_hand", True),
    ("tiago", "arm_tool_link", True),
    ("go2", "FL_foot", False),
    ("baxter", "left_gripper", False),
    ("ur5", "ee_link", False),
]
STANDING = Base((1, -2, 0.335), (0, 0, math.sin(0.4), math.cos(0.4)), (0, 0, 0), (0, 0, 0))


class Demo:
    """A demonstration robot in its home pose."""

    def __init__(self, name: str) -> None:
        model = MODELS[name]
        self.urdf = (data_folder() / model.file).read_text()
        self.floating = model.floating
        robot = RobotModel.parse(self.urdf)
        self.home = {joint.name: model.home.get(joint.name, 0.0) for joint in robot.joints.values() if joint.movable}
        self.movable = {joint.name for joint in robot.joints.values() if joint.commandable}
        self.limits = {
            joint.name: (joint.limits.lower, joint.limits.upper)
            for joint in robot.joints.values()
            if joint.limits.lower is not None and joint.limits.upper is not None
        }
        self._model = robot

    def pose(self, link: str, positions: Mapping[str, float]) -> Pose:
        root = base_pose(STANDING) if self.floating else ORIGIN
        pose = LinkPoses(self._model, self.home | dict(positions), root).pose(link)
        assert pose is not None
        return pose

    def random(self, seeded: np.random.Generator) -> dict[str, float]:
        return {name: float(seeded.uniform(*self.limits.get(name, (-3, 3)))) for name in self.home}

    def reach(self, link: str, pose: Pose, oriented: bool = True) -> Solution:
        orientation = pose.orientation_xyzw if oriented else None
        asked = (pose.position_m, orientation, self.home, self.limits, self.movable, STANDING)
        return reach(self.urdf, self.floating, link, *asked, "world")


def angle(a: Pose, b: Pose) -> float:
    """Return the angle between two orientations in rad."""
    x, y = np.array(a.orientation_xyzw), np.array(b.orientation_xyzw)
    return 4 * math.asin(min(1.0, min(np.linalg.norm(x - y), np.linalg.norm(x + y)) / 2))


@pytest.mark.parametrize(("name", "link", "oriented"), CASES)
def test_poses_that_the_robot_can_take_are_found(name: str, link: str, oriented: bool) -> None:
    robot, seeded, solved = Demo(name), np.random.default_rng(11), 0
    for _ in range(20):
        wanted = robot.pose(link, robot.random(seeded))
        try:
            found = robot.reach(link, wanted, oriented)
        except Unreachable:
            continue
        solved += 1
        got = robot.pose(link, found.positions)
        assert math.dist(got.position_m, wanted.position_m) <= TOLERANCE_M + 1e-9
        assert found.residual_m <= TOLERANCE_M
        assert found.iterations <= MAX_ITERATIONS
        if oriented:
            assert angle(got, wanted) <= TOLERANCE_RAD + 1e-7
        for joint, position in found.positions.items():
            lower, upper = robot.limits[joint]
            assert lower <= position <= upper
    assert solved >= 19


@pytest.mark.parametrize(("name", "link", "oriented"), CASES)
def test_a_link_that_is_there_already_stays(name: str, link: str, oriented: bool) -> None:
    robot = Demo(name)
    found = robot.reach(link, robot.pose(link, {}), oriented)
    assert found.positions == {joint: robot.home[joint] for joint in found.positions}
    assert found.iterations == 1


def test_a_small_move_moves_the_joints_a_little() -> None:
    robot = Demo("panda")
    here = robot.pose("panda_hand", {})
    x, y, z = here.position_m
    found = robot.reach("panda_hand", Pose((x, y, z + 0.01), here.orientation_xyzw))
    assert max(abs(position - robot.home[joint]) for joint, position in found.positions.items()) < 0.1
    assert set(found.positions) == {f"panda_joint{i}" for i in range(1, 8)}


@pytest.mark.parametrize("frame", ["base", "world"])
def test_a_foot_is_reached_in_the_frame_of_the_body_and_of_the_world(frame: Literal["base", "world"]) -> None:
    robot, target = Demo("go2"), (0.25, 0.15, -0.2)
    base = STANDING if frame == "world" else Base((0, 0, 0), (0, 0, 0, 1), (0, 0, 0), (0, 0, 0))
    (x, y, z), (_, _, sin, cos) = base.position_m, base.orientation_xyzw
    c, s = cos * cos - sin * sin, 2 * sin * cos
    asked = (x + c * target[0] - s * target[1], y + s * target[0] + c * target[1], z + target[2])
    known = base if frame == "world" else None
    found = reach(robot.urdf, True, "FL_foot", asked, None, robot.home, robot.limits, robot.movable, known, frame)
    model = RobotModel.parse(robot.urdf)
    foot = LinkPoses(model, robot.home | found.positions, base_pose(base)).pose("FL_foot")
    assert foot is not None
    assert math.dist(foot.position_m, asked) <= TOLERANCE_M + 1e-9
    assert set(found.positions) == {"FL_hip_joint", "FL_thigh_joint", "FL_calf_joint"}


ARM = """<robot name='r'><link name='root'/><link name='upper'/><link name='lower'/><link name='tip'/><link name='f'/>
<joint name='shoulder' type='continuous'><parent link='root'/><child link='upper'/><axis xyz='0 0 1'/></joint>
<joint name='elbow' type='revolute'><parent link='upper'/><child link='lower'/><origin xyz='1 0 0'/><axis xyz='0 0 1'/>
<limit lower='-2' upper='2' effort='1' velocity='1'/></joint>
<joint name='fix' type='fixed'><parent link='lower'/><child link='tip'/><origin xyz='1 0 0'/></joint>
<joint name='finger' type='prismatic'><parent link='root'/><child link='f'/><axis xyz='0 1 0'/>
<limit lower='-9' upper='9' effort='1' velocity='1'/>{mimic}</joint></robot>"""
PLAIN = ARM.format(mimic="")
LIMITS = {"elbow": (-2.0, 2.0), "finger": (-9.0, 9.0)}


def arm(
    position: tuple[float, float, float] = (1.0, 1.0, 0.0),
    orientation: tuple[float, float, float, float] | None = None,
    *,
    urdf: str = PLAIN,
    link: str = "tip",
    movable: tuple[str, ...] = ("shoulder", "elbow", "finger"),
    limits: Mapping[str, tuple[float, float]] = LIMITS,
    base: Base | None = None,
    floating: bool = False,
    **start: float,
) -> Solution:
    at = {"shoulder": 0.3, "elbow": 0.4, "finger": 0.0} | start
    return reach(
        urdf, floating, link, position, orientation, at, limits, movable, base, "world" if floating else "base"
    )


def tip(positions: Mapping[str, float]) -> tuple[float, float]:
    a, b = positions["shoulder"], positions["shoulder"] + positions["elbow"]
    return math.cos(a) + math.cos(b), math.sin(a) + math.sin(b)


def about_z(degrees: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(math.radians(degrees) / 2), math.cos(math.radians(degrees) / 2)


def test_an_arm_of_two_links_computed_by_hand() -> None:
    found = arm((1, 1, 0), about_z(90))
    assert found.positions == pytest.approx({"shoulder": 0, "elbow": math.pi / 2}, abs=3e-4)


@pytest.mark.parametrize("turns", [-3.0, 0.0, 3.0, 20.0])
@pytest.mark.parametrize("aside", [-3.0, -1.0, 0.5, 3.1])
def test_a_continuous_joint_goes_the_short_way(turns: float, aside: float) -> None:
    start = turns * math.tau
    target = (2 * math.cos(start + aside), 2 * math.sin(start + aside), 0.0)
    found = arm(target, about_z(math.degrees(aside)), movable=("shoulder",), shoulder=start, elbow=0.0)
    assert found.positions["shoulder"] == pytest.approx(start + aside, abs=1e-4)


def test_whole_turns_that_the_limits_forbid_are_not_undone() -> None:
    urdf = PLAIN.replace("continuous'>", "revolute'><limit lower='1' upper='6.5' effort='1' velocity='1'/>")
    found = arm((2, 0, 0), urdf=urdf, limits=LIMITS | {"shoulder": (1.0, 6.5)}, shoulder=1.2, elbow=0.1)
    assert 1 <= found.positions["shoulder"] <= 6.5
    assert tip(found.positions) == pytest.approx((2, 0), abs=1e-4)


def test_joints_that_may_not_move_stay_where_they_are() -> None:
    found = arm((math.cos(1) + math.cos(1.4), math.sin(1) + math.sin(1.4), 0), movable=("shoulder",))
    assert found.positions == pytest.approx({"shoulder": 1}, abs=1e-4)
    with pytest.raises(Unreachable, match=r"tip comes no nearer than .* mm: no movable joint moves it"):
        arm(movable=("finger",))


def test_a_joint_outside_its_limits_is_brought_inside() -> None:
    assert arm((2, 0, 0), limits={"elbow": (-0.5, 0.5)}, elbow=1.9).positions["elbow"] == pytest.approx(0, abs=0.02)


@pytest.mark.parametrize("target", [(0.2, 0, 0), (3.0, 0, 0), (0, -2.1, 0), (0, 0, 1.5), (60.0, 80.0, 0)])
def test_out_of_reach_is_told_with_the_distance_that_is_missing(target: tuple[float, float, float]) -> None:
    nearest = min(
        math.dist((*tip({"shoulder": shoulder, "elbow": elbow}), 0), target)
        for shoulder in np.linspace(-math.pi, math.pi, 361)
        for elbow in np.linspace(-2, 2, 81)
    )
    with pytest.raises(Unreachable) as told:
        arm(target)
    best = told.value.best
    assert math.dist((*tip(best.positions), 0), target) == pytest.approx(best.residual_m)
    assert best.residual_m == pytest.approx(nearest, abs=2e-3)
    assert f"{best.residual_m * 1000:.1f} mm" in str(told.value)
    assert ("elbow is at its" in str(told.value)) == (math.hypot(*target[:2]) < 1)


def test_an_orientation_out_of_reach_is_told_in_degrees() -> None:
    tilted = (math.sin(math.pi / 12), 0.0, 0.0, math.cos(math.pi / 12))
    with pytest.raises(Unreachable, match=r"mm and 30\.\d\d°") as told:
        arm((2, 0, 0), tilted, limits={"elbow": (0.0, 0.0)}, elbow=0.0)
    assert told.value.best.residual_rad == pytest.approx(math.radians(30), abs=2e-3)
    assert told.value.best.residual_m == pytest.approx(0, abs=2e-3)


def following(joint: str, factor: float, offset: float) -> str:
    return ARM.format(mimic=f"<mimic joint='{joint}' multiplier='{factor}' offset='{offset}'/>")


def test_a_mimic_joint_follows_its_master() -> None:
    found = arm((0, -1.5, 0), urdf=following("elbow", -2, 0.5), link="f", movable=("shoulder", "elbow"))
    assert found.positions == pytest.approx({"elbow": 1.0}, abs=1e-4)


def test_the_limits_of_a_mimic_joint_bind_its_master() -> None:
    urdf = following("elbow", -2, 0.5)
    with pytest.raises(Unreachable, match="elbow is at its upper limit") as told:
        arm((0, -1.5, 0), urdf=urdf, link="f", movable=("elbow",), limits=LIMITS | {"finger": (-1.0, 1.0)})
    assert told.value.best.positions == pytest.approx({"elbow": 0.75})


def test_a_mimic_joint_follows_through_another() -> None:
    urdf = following("elbow", 2, 0).replace(
        "<limit lower='-2'", "<mimic joint='shoulder' multiplier='0.5' offset='0.1'/><limit lower='-2'"
    )
    found = arm((0, 1.2, 0), urdf=urdf, link="f", movable=("shoulder",))
    assert found.positions == pytest.approx({"shoulder": 1.0}, abs=1e-4)


def test_a_mimic_joint_that_cannot_follow_stays() -> None:
    assert arm((0, 0.7, 0), urdf=following("elbow", 1e10, 0), link="f", finger=0.7).positions == {}


@pytest.mark.parametrize("joint", ["shoulder", "elbow"])
def test_an_unknown_position_is_named(joint: str) -> None:
    with pytest.raises(ValueError, match=f"'{joint}' is unknown"):
        arm(**{joint: math.nan})
    with pytest.raises(ValueError, match=f"'{joint}' is unknown"):
        reach(
            PLAIN, False, "tip", (1, 1, 0), None, {"shoulder": 0, "elbow": 0} | {joint: math.nan}, {}, (), None, "base"
        )


def test_joints_beside_the_chain_may_have_unknown_positions() -> None:
    assert arm(finger=math.nan).residual_m <= TOLERANCE_M


def test_a_joint_without_one_position_is_named() -> None:
    with pytest.raises(ValueError, match="floating joint 'shoulder' is unknown"):
        arm(urdf=PLAIN.replace("continuous", "floating"))


def test_in_the_world_a_floating_robot_needs_its_base() -> None:
    with pytest.raises(ValueError, match="base is unknown"):
        arm(floating=True)
    with pytest.raises(ValueError, match="orientation of the base"):
        arm(floating=True, base=Base((0, 0, 0), (0, 0, 0, 0), (0, 0, 0), (0, 0, 0)))


def test_a_joint_may_have_the_name_of_a_link() -> None:
    renamed = PLAIN.replace("'elbow'", "'upper'").replace("'fix'", "'tip'")
    found = arm((1, 1, 0), about_z(90), urdf=renamed, movable=("shoulder", "upper"), upper=0.4)
    assert found.positions == pytest.approx({"shoulder": 0, "upper": math.pi / 2}, abs=3e-4)


def test_an_unknown_link_is_named() -> None:
    with pytest.raises(ValueError, match="no link 'tipp'"):
        arm(link="tipp")


def test_the_root_is_where_it_is() -> None:
    assert arm((0, 0, 0), (0, 0, 0, 1), link="root").positions == {}
    with pytest.raises(Unreachable):
        arm((1, 0, 0), link="root")


@pytest.mark.parametrize("target", [(1e300, 0.0, 0.0), (-1.7e308, 1.7e308, 1.7e308), (0.0, 1e7, 0.0)])
def test_targets_absurdly_far_are_unreachable(target: tuple[float, float, float]) -> None:
    for base in (None, STANDING, Base((-1.7e308, 0, 0), (0, 0, 0, 1), (0, 0, 0), (0, 0, 0))):
        with pytest.raises(Unreachable, match="cannot be") as told:
            arm(target, base=base, floating=base is not None)
        assert told.value.best.residual_m >= 1e6


def test_robots_too_large_to_compute_are_a_model_error() -> None:
    with pytest.raises(ModelError, match="km long"):
        arm(urdf=PLAIN.replace("1 0 0'", "1e10 0 0'"))
    links = "".join(f"<link name='l{i}'/>" for i in range(130))
    joints = "".join(
        f"<joint name='j{i}' type='continuous'><parent link='l{i}'/><child link='l{i + 1}'/></joint>"
        for i in range(129)
    )
    with pytest.raises(ModelError, match="129 degrees of freedom are too many"):
        arm(urdf=f"<robot name='r'>{links}{joints}</robot>", link="l5")


@pytest.mark.parametrize("limits", [(1.0, -1.0), (math.nan, 1.0), (1e7, 1e8), (math.inf, math.inf)])
def test_limits_that_leave_no_position_are_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="elbow"):
        arm(limits={"elbow": limits})


ANY = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=examples(60))
@given(st.tuples(ANY, ANY, ANY), st.none() | st.tuples(ANY, ANY, ANY, ANY), ANY, st.tuples(ANY, ANY))
def test_hostile_numbers_end_in_an_answer_or_a_refusal(
    position: tuple[float, float, float],
    orientation: tuple[float, float, float, float] | None,
    start: float,
    limits: tuple[float, float],
) -> None:
    try:
        found = arm(position, orientation, limits={"elbow": limits}, elbow=start)
    except Unreachable as error:
        found = error.best
        assert found.residual_m > TOLERANCE_M or found.residual_rad > TOLERANCE_RAD
    except ValueError:
        return
    assert limits[0] <= found.positions["elbow"] <= limits[1]
    assert math.isfinite(found.positions["shoulder"])
    assert found.iterations <= MAX_ITERATIONS


@settings(max_examples=examples(40))
@given(st.tuples(ANY, ANY, ANY), st.tuples(ANY, ANY, ANY, ANY))
def test_hostile_bases_end_in_an_answer_or_a_refusal(
    at: tuple[float, float, float], turned: tuple[float, float, float, float]
) -> None:
    try:
        found = arm(floating=True, base=Base(at, turned, (0, 0, 0), (0, 0, 0)))
    except (ValueError, Unreachable):
        return
    assert found.residual_m <= TOLERANCE_M
