"""Balls around all reachable places of a link, compared with the places of five real robots."""

import math
import random
import site
from pathlib import Path

import pytest

from linked_fleet_gateway.extensions.reach.envelope import envelope
from linked_fleet_state.kinematics import ORIGIN, LinkPoses
from linked_fleet_state.model import Joint, JointKind, RobotModel

ROBOTS = Path(site.getsitepackages()[0]) / "cmeel.prefix/share/example-robot-data/robots"
FILES = [
    "baxter_description/urdf/baxter.urdf",
    "ur_description/urdf/ur5_robot.urdf",
    "panda_description/urdf/panda.urdf",
    "tiago_description/robots/tiago.urdf",
    "go2_description/urdf/go2.urdf",
]
TWO_LINKS = """<robot name='r'><link name='a'/><link name='b'/><link name='c'/>
<joint name='turn' type='{kind}'><parent link='a'/><child link='b'/><origin xyz='0 0 1'/><axis xyz='0 0 1'/>
<limit lower='{lower}' upper='{upper}' effort='1' velocity='1'/></joint>
<joint name='end' type='{end}'><parent link='b'/><child link='c'/><origin xyz='2 0 0.5'/></joint></robot>"""


def position(joint: Joint) -> float:
    """Return a position, often at one of the limits."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.kind is JointKind.CONTINUOUS or lower is None or upper is None:
        return random.uniform(-math.pi, math.pi)
    return random.choice([lower, upper, random.uniform(lower, upper)])


@pytest.mark.parametrize("file", FILES)
def test_every_link_is_in_its_envelope_wherever_the_joints_are(file: str) -> None:
    random.seed(file)
    model = RobotModel.parse((ROBOTS / file).read_text())
    movable = [joint.name for joint in model.joints.values() if joint.commandable]
    balls = {link: envelope(model, link, movable) for link in model.links}
    for _ in range(50):
        at = {joint.name: position(joint) for joint in model.joints.values() if joint.movable}
        for joint in model.joints.values():
            if joint.mimic is not None:
                at[joint.name] = at[joint.mimic.joint] * joint.mimic.multiplier + joint.mimic.offset
        poses = LinkPoses(model, at, ORIGIN)
        for link, ball in balls.items():
            pose = poses.pose(link)
            assert pose is None or ball.contains(pose.position_m, 1e-9), link


def test_an_arm_that_turns_a_little_sweeps_a_small_ball() -> None:
    model = RobotModel.parse(TWO_LINKS.format(kind="revolute", lower=-0.1, upper=0.1, end="fixed"))
    ball = envelope(model, "c", ["turn"])
    assert ball.centre == pytest.approx((2 * math.cos(0.1), 0, 1.5))
    assert ball.radius == pytest.approx(2 * math.sin(0.1))
    assert not ball.contains((-2, 0, 1.5), 1e-6)


@pytest.mark.parametrize(("kind", "movable"), [("revolute", []), ("continuous", ["turn"])])
def test_a_joint_that_may_stand_anywhere_sweeps_a_whole_turn(kind: str, movable: list[str]) -> None:
    model = RobotModel.parse(TWO_LINKS.format(kind=kind, lower=-0.1, upper=0.1, end="fixed"))
    ball = envelope(model, "c", movable)
    assert (ball.centre, ball.radius) == (pytest.approx((0, 0, 1.5)), pytest.approx(2))


@pytest.mark.parametrize("end", ["floating", "planar"])
def test_nothing_is_out_of_reach_behind_a_joint_of_several_degrees_of_freedom(end: str) -> None:
    model = RobotModel.parse(TWO_LINKS.format(kind="revolute", lower=-0.1, upper=0.1, end=end))
    assert envelope(model, "c", ["turn"]).contains((1e9, 0, 0), 0)


def test_limits_beyond_all_numbers_leave_everything_in_reach() -> None:
    model = RobotModel.parse(TWO_LINKS.format(kind="revolute", lower=1.7e308, upper=1.7e308, end="fixed"))
    assert envelope(model, "c", ["turn"]).contains((0, 2, 1.5), 1e-6)
