"""Parsing URDFs: five real ones completely, broken ones with a sentence that names the fault."""

import gc
import math
import site
from pathlib import Path

import pytest

from linked_fleet_agent.urdf import RobotModel, UrdfError
from linked_fleet_agent.urdf.joints import JointKind, Mimic
from linked_fleet_agent.urdf.limits import Limits

ROBOTS = Path(site.getsitepackages()[0]) / "cmeel.prefix/share/example-robot-data/robots"


def urdf(path: str) -> str:
    return (ROBOTS / path).read_text()


def robot(body: str) -> str:
    return f"<robot name='r'>{body}</robot>"


PAIR = "<link name='a'/><link name='b'/>"


def joint(body: str = "", kind: str = "revolute", name: str = "j", ends: str = "ab") -> str:
    return f"<joint name='{name}' type='{kind}'><parent link='{ends[0]}'/><child link='{ends[1]}'/>{body}</joint>"


@pytest.mark.parametrize(
    ("path", "root", "joints", "commandable"),
    [
        ("baxter_description/urdf/baxter.urdf", "base", 56, 17),
        ("ur_description/urdf/ur5_robot.urdf", "world", 10, 6),
        ("panda_description/urdf/panda.urdf", "panda_link0", 12, 8),
        ("tiago_description/robots/tiago.urdf", "base_footprint", 77, 48),
        ("go2_description/urdf/go2.urdf", "base", 30, 12),
    ],
)
def test_real_robots_are_read_whole(path: str, root: str, joints: int, commandable: int) -> None:
    model = RobotModel.parse(urdf(path))
    assert (model.root, len(model.joints), len(model.links)) == (root, joints, joints + 1)
    assert sum(one.commandable for one in model.joints.values()) == commandable


def test_the_neighbours_of_right_s1_are_those_of_figure_2b() -> None:
    model = RobotModel.parse(urdf("baxter_description/urdf/baxter.urdf"))
    s1 = model.joints["right_s1"]
    assert (s1.kind, s1.parent, s1.child) == (JointKind.REVOLUTE, "right_upper_shoulder", "right_lower_shoulder")
    assert model.links[s1.parent].parent_joint == "right_s0"
    assert s1.name in model.links[s1.parent].child_joints
    assert (s1.limits.lower, s1.limits.upper) == (-2.147, 1.047)


def test_every_joint_is_unknown_where_the_file_is_silent() -> None:
    one = RobotModel.parse(robot(PAIR + joint(kind="continuous"))).joints["j"]
    assert (one.limits, one.friction, one.damping, one.mimic) == (Limits(None, None, None, None), None, None, None)
    assert one.axis == (1, 0, 0)
    assert one.origin.orientation_xyzw == (0, 0, 0, 1)


def test_an_omitted_end_of_a_limit_is_zero() -> None:
    one = RobotModel.parse(robot(PAIR + joint("<limit upper='2' effort='3' velocity='4'/>"))).joints["j"]
    assert one.limits == Limits(0, 2, 4, 3)


def test_the_axis_is_a_unit_vector_and_a_fixed_joint_needs_none() -> None:
    assert RobotModel.parse(robot(PAIR + joint("<axis xyz='0 3 4'/>"))).joints["j"].axis == pytest.approx((0, 0.6, 0.8))
    RobotModel.parse(robot(PAIR + joint("<axis xyz='0 0 0'/>", kind="fixed")))


def test_a_mimic_joint_moves_but_takes_no_commands() -> None:
    links = PAIR + "<link name='c'/>"
    body = joint() + joint("<mimic joint='j' multiplier='-2'/>", name="k", ends="bc")
    one = RobotModel.parse(robot(links + body)).joints["k"]
    assert one.mimic == Mimic("j", -2, 0)
    assert one.movable
    assert not one.commandable


def test_two_hyphens_in_a_comment_are_read_and_lines_are_counted_past_it() -> None:
    comment = "<!-- a -- b\n-->"
    assert RobotModel.parse(robot(f"{comment}{PAIR}{comment}{joint()}")).joints["j"].parent == "a"
    with pytest.raises(UrdfError, match="line 3"):
        RobotModel.parse(f"<robot name='r'>{comment}{comment}</x></robot>")


def test_mimics_of_mimics_are_followed_to_the_end_of_a_long_chain() -> None:
    links = "".join(f"<link name='l{i}'/>" for i in range(1025))
    mimics = ["", *(f"<mimic joint='j{i}'/>" for i in range(1023))]
    chain = "".join(
        f"<joint name='j{i}' type='revolute'><parent link='l{i}'/><child link='l{i + 1}'/>"
        f"<limit lower='-1' upper='1'/>{mimic}</joint>"
        for i, mimic in enumerate(mimics)
    )
    joints = RobotModel.parse(robot(links + chain)).joints
    assert not any(each.refusal for each in joints.values())
    last = joints["j1023"].mimic
    assert last is not None and last.joint == "j1022"


def test_a_joint_and_a_link_may_share_a_name() -> None:
    model = RobotModel.parse(robot(PAIR + joint(name="b")))
    assert model.joints["b"].child == model.links["b"].name == "b"


def test_inertia_is_given_in_the_axes_of_the_link() -> None:
    inertial = (
        f"<inertial><origin xyz='1 2 3' rpy='0 0 {math.pi / 2}'/><mass value='5'/>"
        "<inertia ixx='1' iyy='2' izz='3' ixy='0.5' ixz='0' iyz='0'/></inertial>"
    )
    found = RobotModel.parse(robot(f"<link name='a'>{inertial}</link>")).links["a"].inertial
    assert found is not None
    assert (found.mass_kg, found.centre_m) == (5, (1, 2, 3))
    assert found.inertia_kg_m2 == pytest.approx((2, -0.5, 0, 1, 0, 3))


def test_an_indefinite_inertia_is_described_and_no_error() -> None:
    inertia = "<inertia ixx='-1' iyy='2' izz='3' ixy='9' ixz='0' iyz='0'/>"
    text = robot(f"<link name='a'><inertial><mass value='1'/>{inertia}</inertial></link>")
    inertial = RobotModel.parse(text).links["a"].inertial
    assert inertial is not None
    assert inertial.inertia_kg_m2 == (-1, 9, 0, 2, 0, 3)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "no well-formed XML"),
        ("<robot name='r'>\n<link name='a'>\n</robot>", "line 3"),
        ("<!DOCTYPE r [<!ENTITY a 'b'>]><robot name='r'/>", "document type or an entity"),
        ("<sdf/>", "not <robot>"),
        ("<robot><link name='a'/></robot>", "has no name"),
        (robot(""), "no link"),
        (robot("<link name='a'/><link name='a'/>"), "two links are called 'a'"),
        (robot(f"<link name='{'x' * 129}'/>"), "no name of 1 to 128"),
        (robot(PAIR), "no single tree"),
        (robot("<link name='b'/>" + joint()), "parent 'a', but no link"),
        (robot("<link name='a'/>" + joint()), "child 'b', but no link"),
        (robot(PAIR + joint() + joint(name="k", ends="ba")), "cycle"),
        (robot("<link name='c'/>" + PAIR + joint() + joint(name="k", ends="ba")), "cycle"),
        (robot(PAIR + joint() + joint(name="k")), "child of both 'j' and 'k'"),
        (robot(PAIR + joint() + joint()), "two joints are called 'j'"),
        (robot(PAIR + "<joint name='j' type='fixed'><child link='b'/></joint>"), "lacks its parent"),
        (robot(PAIR + joint("<origin xyz='0 nan 0'/>")), "not a finite number"),
        (robot(PAIR + joint("<origin xyz='0 1e999 0'/>")), "not a finite number"),
        (robot(PAIR + joint("<origin xyz='0 1e300 0'/>")), "beyond 1e\\+12, which no robot has"),
        ("<robot name='\ud800'/>", "no text that XML allows"),
        (f"<robot name='r'>{'<a>' * 5000}{'</a>' * 5000}</robot>", "nested deeper than 64"),
        (f"<robot name='r'>{'<a/>' * 200_000}</robot>", "more than 50000 elements"),
        (f"<robot name='r'>{' ' * 8_000_000}</robot>", "8000024 characters"),
        ("<robot " + " ".join(f"a{i}=''" for i in range(200_001)) + "/>", "has at most 200000 attributes"),
        (f"<robot name='r'>{'<!--' * 1_900_000}</robot>", "no well-formed XML"),
    ],
)
def test_a_broken_urdf_is_refused_with_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(UrdfError, match=sentence):
        RobotModel.parse(text)


@pytest.mark.parametrize("value", ["-1", "nan", "stiff"])
def test_damping_and_friction_that_cannot_be_are_unknown(value: str) -> None:
    model = RobotModel.parse(robot(PAIR + joint(f"<limit upper='1'/><dynamics damping='{value}' friction='{value}'/>")))
    assert (model.joints["j"].damping, model.joints["j"].friction) == (None, None)
    assert [each.split(":")[0] for each in model.findings_about("joint", "j")] == [
        "Joint 'j' has unknown friction",
        "Joint 'j' has unknown damping",
    ]


def test_depth_and_number_of_links_are_bounded() -> None:
    deep = "".join(f"<link name='l{i}'/>" for i in range(2048)) + "".join(
        f"<joint name='j{i}' type='fixed'><parent link='l{i}'/><child link='l{i + 1}'/></joint>" for i in range(2047)
    )
    assert len(RobotModel.parse(robot(deep)).links) == 2048
    with pytest.raises(UrdfError, match="more than 2048 links"):
        RobotModel.parse(robot("<link name='x'/>" + deep))


def test_a_reader_leaves_no_garbage_in_cycles() -> None:
    """A gateway collects cycles rarely, and the text of a robot is large."""
    text = robot(PAIR + joint("<limit upper='1'/>"))
    RobotModel.parse(text)
    while gc.collect():  # of other tests; classes take more than one pass
        pass
    gc.disable()
    try:
        RobotModel.parse(text)
        assert gc.collect() < 10
    finally:
        gc.enable()
