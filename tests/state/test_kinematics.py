"""Link poses of five real robots compared with MuJoCo for the same files, and unknown poses."""

import math
import site
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from linked_fleet_agent.wire.messages import Base
from linked_fleet_state.kinematics import ORIGIN, LinkPoses, base_pose, compose, inverse
from linked_fleet_state.model import ModelError, Pose, RobotModel
from linked_fleet_state.pinocchio_model import build_model

ROBOTS = Path(site.getsitepackages()[0]) / "cmeel.prefix/share/example-robot-data/robots"
FILES = [
    "baxter_description/urdf/baxter.urdf",
    "ur_description/urdf/ur5_robot.urdf",
    "panda_description/urdf/panda.urdf",
    "tiago_description/robots/tiago.urdf",
    "go2_description/urdf/go2.urdf",
]
CHAIN = """<robot name='r'><link name='a'/><link name='b'/><link name='c'/>
<joint name='turn' type='continuous'><parent link='a'/><child link='b'/><origin xyz='0 0 1'/><axis xyz='0 0 1'/></joint>
<joint name='slide' type='prismatic'><parent link='b'/><child link='c'/><origin xyz='1 0 0'/><axis xyz='0 2 0'/>
<limit lower='0' upper='1' effort='1' velocity='1'/></joint></robot>"""


def link_poses(
    urdf: str, positions: dict[str, float], base: Base | None = None, *, floating: bool = False
) -> dict[str, Pose | None]:
    model = RobotModel.parse(urdf)
    poses = LinkPoses(model, positions, base_pose(base) if floating else ORIGIN)
    return {link: poses.pose(link) for link in reversed(model.links)}


def bare(text: str) -> str:
    """Return only the tree: no shapes (MuJoCo would load meshes), no inertia (MuJoCo checks it), no limits."""
    root = ElementTree.fromstring(text)
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
    for link in root.iter("link"):
        for child in list(link):
            link.remove(child)
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "mass", value="1")
        ElementTree.SubElement(inertial, "inertia", ixx="1", iyy="1", izz="1", ixy="0", ixz="0", iyz="0")
    options = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    options.set("fusestatic", "false")
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.parametrize("path", FILES)
def test_link_poses_are_those_of_mujoco(path: str) -> None:
    text = (ROBOTS / path).read_text()
    robot = RobotModel.parse(text)
    model = mujoco.MjModel.from_xml_string(bare(text))
    data = mujoco.MjData(model)
    random = np.random.default_rng(7)
    positions = {name: float(random.uniform(-1, 1)) for name, joint in robot.joints.items() if joint.movable}
    for name, position in positions.items():
        data.joint(name).qpos = position
    mujoco.mj_kinematics(model, data)
    poses = link_poses(text, positions)
    assert set(poses) == set(robot.links)
    for name, pose in poses.items():
        assert pose is not None
        if name != robot.root:  # the root is MuJoCo's nameless world
            assert pose.position_m == pytest.approx(data.body(name).xpos, abs=1e-9)
            x, y, z, w = pose.orientation_xyzw
            assert abs(np.dot(data.body(name).xquat, (w, x, y, z))) == pytest.approx(1, abs=1e-9)


def test_a_chain_computed_by_hand() -> None:
    pose = link_poses(CHAIN, {"turn": math.pi / 2, "slide": 0.5})["c"]
    assert pose is not None
    assert pose.position_m == pytest.approx((-0.5, 1, 1))
    assert pose.orientation_xyzw == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)))


def test_only_links_behind_an_unknown_joint_are_unknown() -> None:
    for positions in ({"turn": 0.0}, {"turn": 0.0, "slide": math.nan}):
        poses = link_poses(CHAIN, positions)
        assert poses["c"] is None
        assert poses["b"] == Pose((0, 0, 1), (0, 0, 0, 1))
    assert link_poses(CHAIN, {"slide": 0.5})["c"] is None


def base(orientation: tuple[float, float, float, float]) -> Base:
    return Base((1, 2, 3), orientation, (0, 0, 0), (0, 0, 0))


def test_a_floating_base_carries_the_robot() -> None:
    poses = link_poses(CHAIN, {"turn": 0.0, "slide": 0.5}, base((0, 0, 2, 2)), floating=True)
    assert poses["a"] is not None
    assert poses["a"].position_m == (1, 2, 3)
    assert poses["c"] is not None
    assert poses["c"].position_m == pytest.approx((0.5, 3, 4))


@pytest.mark.parametrize("unknown", [None, base((0, 0, 0, 0)), base((math.nan, 0, 0, 1))])
def test_without_a_known_base_a_floating_robot_is_nowhere(unknown: Base | None) -> None:
    poses = link_poses(CHAIN, {"turn": 0.0, "slide": 0.5}, unknown, floating=True)
    assert set(poses.values()) == {None}


def test_positions_that_overflow_are_unknown() -> None:
    far = base((0, 0, 0, 1))
    far = Base((0, 1.7e308, 0), far.orientation_xyzw, far.linear_m_s, far.angular_rad_s)
    poses = link_poses(CHAIN, {"turn": 0.0, "slide": 1.7e308}, far, floating=True)
    assert poses["b"] is not None
    assert poses["c"] is None


def test_to_plan_with_absurdly_many_joints_is_refused_before_it_takes_memory() -> None:
    links = "".join(f"<link name='l{i}'/>" for i in range(601))
    joints = "".join(
        f"<joint name='j{i}' type='continuous'><parent link='l{i}'/><child link='l{i + 1}'/></joint>"
        for i in range(600)
    )
    with pytest.raises(ModelError, match="600 degrees of freedom are too many"):
        build_model(f"<robot name='r'>{links}{joints}</robot>", floating=False)


def test_a_description_that_our_reader_refuses_is_not_passed_on() -> None:
    with pytest.raises(ModelError, match="the robot has no link"):
        build_model("<robot name='r'/>", floating=False)


def test_a_turn_of_any_size_has_one_quaternion() -> None:
    for turn in (0.3, math.pi - 1e-9, math.pi + 1e-9):
        found = [link_poses(CHAIN, {"turn": turn + turns * math.tau})["b"] for turns in (-1, 0, 1)]
        assert [pose and pose.orientation_xyzw for pose in found] == [
            pytest.approx((0, 0, math.sin(turn / 2), math.cos(turn / 2)), abs=1e-9)
        ] * 3


def test_a_link_that_there_is_not_is_nowhere() -> None:
    assert LinkPoses(RobotModel.parse(CHAIN), {}, ORIGIN).pose("z") is None


@pytest.mark.parametrize("kind", ["floating", "planar", "revolute"])
def test_links_behind_a_joint_of_unknown_position_have_known_poses_between_them(kind: str) -> None:
    urdf = CHAIN.replace("'turn' type='continuous'", f"'turn' type='{kind}'")
    poses = LinkPoses(RobotModel.parse(urdf), {"turn": math.nan, "slide": 0.5}, None)
    known = link_poses(CHAIN, {"turn": 0.0, "slide": 0.5})
    b, c = known["b"], known["c"]
    assert b is not None and c is not None
    assert poses.between("b", "c") == compose(inverse(b), c) and poses.between("c", "b") == compose(inverse(c), b)
    assert poses.between("a", "b") is poses.between("c", "a") is None
    assert poses.pose("c") is None
