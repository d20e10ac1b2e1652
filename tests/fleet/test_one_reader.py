"""One reader of descriptions: the same poses and the same refusals in agent, gateway, check, simulation and pages."""

import math
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from descriptions_of_robots import BAR, INERTIAL, LIMIT, arm, described, read_by_agent, read_by_gateway
from linked_fleet_agent.robots.mujoco_model import build
from linked_fleet_agent.urdf import joints_of
from linked_fleet_gateway.extensions.models.geometry import urdf_with_mesh_addresses
from linked_fleet_gateway.extensions.world.shapes import build_robot
from linked_fleet_state.kinematics import ORIGIN, LinkPoses
from linked_fleet_state.model import Pose, RobotModel
from linked_fleet_state.pinocchio_model import build_model
from linked_fleet_state.xml import rotation

_AT = {"j1": 0.4, "j2": -0.9}
_HALF = math.sqrt(0.5)
_QUARTER_X, _QUARTER_Y = f'quat_xyzw="{_HALF} 0 0 {_HALF}"', f'quat_xyzw="0 {2 * _HALF} 0 {2 * _HALF}"'
_RPY_X, _RPY_Y = f'rpy="{math.pi / 2} 0 0"', f'rpy="0 {math.pi / 2} 0"'


def _turned(first: str, shape: str, version: str = ' version="1.1"') -> str:
    origin = f'<origin xyz="0 0 0.15" {shape}/>'
    upper = f"{INERTIAL}<visual>{origin}{BAR}</visual><collision>{origin}{BAR}</collision>"
    return arm(f'<origin xyz="0.1 0 0.4" {first}/>{LIMIT}', upper, version)


_QUATERNIONS = _turned(_QUARTER_X, _QUARTER_Y)
_OLD_VERSION = _turned(_QUARTER_X, _QUARTER_Y, "")
_ANGLES = _turned(_RPY_X, _RPY_Y)


def _matrix(pose: Pose) -> np.ndarray:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = np.array(rotation(pose.orientation_xyzw)), pose.position_m
    return found


def _in_resources(urdf: str) -> np.ndarray:
    pose = LinkPoses(RobotModel.parse(urdf), _AT, ORIGIN).pose("tool")
    assert pose is not None
    return _matrix(pose)


def _in_pinocchio(urdf: str) -> np.ndarray:
    model = build_model(urdf, floating=False)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([_AT[name] for name in model.names[1:]]))
    return data.oMf[model.getFrameId("tool", pin.FrameType.BODY)].homogeneous


def _in_mujoco(urdf: str) -> np.ndarray:
    model = build(urdf, "r", joints_of(urdf), {}, False, None)
    data = mujoco.MjData(model)
    for name, position in _AT.items():
        data.qpos[model.joint(name).qposadr[0]] = position
    mujoco.mj_forward(model, data)
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = data.body("tool").xmat.reshape(3, 3), data.body("tool").xpos
    return found


def _on_pages(urdf: str) -> np.ndarray:
    served = urdf_with_mesh_addresses(urdf, {}).decode()
    assert not any("quat_xyzw" in element.attrib for element in ElementTree.fromstring(served).iter())
    return _in_resources(served)


def _collision_shape_of_tool(urdf: str) -> np.ndarray:
    robot = build_robot(urdf.replace('<link name="tool">', f'<link name="tool"><collision>{BAR}</collision>'))
    return robot.geometry.geometryObjects[0].placement.homogeneous


def _collision_shape(urdf: str) -> np.ndarray:
    robot = build_robot(urdf)
    return robot.geometry.geometryObjects[0].placement.homogeneous


@pytest.mark.parametrize("read", [_in_resources, _in_pinocchio, _in_mujoco, _on_pages, _collision_shape])
@pytest.mark.parametrize("urdf", [_QUATERNIONS, _OLD_VERSION], ids=["version 1.1", "no version"])
def test_a_quaternion_is_the_orientation_that_its_angles_are(read: object, urdf: str) -> None:
    assert callable(read)
    assert read(urdf) == pytest.approx(read(_ANGLES), abs=1e-9)
    assert read(urdf) == pytest.approx(read(_ANGLES.replace(' version="1.1"', "")), abs=1e-9)


@pytest.mark.parametrize("urdf", [_QUATERNIONS, _ANGLES])
def test_all_who_compute_poses_agree(urdf: str) -> None:
    poses = [read(urdf) for read in (_in_resources, _in_pinocchio, _in_mujoco, _on_pages)]
    assert poses[0][:3, :3] != pytest.approx(np.eye(3), abs=0.1)
    for pose in poses[1:]:
        assert pose == pytest.approx(poses[0], abs=1e-9)


REFUSED = {
    "version 2.0": (arm(attributes=' version="2.0"'), "URDF version '2.0'"),
    "version without numbers": (arm(attributes=' version="new"'), "URDF version 'new'"),
    "rpy beside quat_xyzw": (arm(f'<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>{LIMIT}'), "of joint 'j1' states both rpy"),
    "rpy beside quat_xyzw of a shape": (
        arm(upper=f'{INERTIAL}<collision><origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>{BAR}</collision>'),
        "collision shape 1 of link 'upper' states both rpy",
    ),
    "quaternion of zeros": (arm(f'<origin quat_xyzw="0 0 0 0"/>{LIMIT}'), "joint 'j1' is '0 0 0 0', which is no orien"),
    "quaternion of three": (arm(f'<origin quat_xyzw="0 0 1"/>{LIMIT}'), "quat_xyzw of joint 'j1' is '0 0 1', not four"),
    "origin that is no number": (arm(f'<origin xyz="0 zero 0"/>{LIMIT}'), "xyz of joint 'j1' is 'zero'"),
    "no tree": (arm(more='<link name="stray"/>'), "form no single tree: 'base', 'stray'"),
}


@pytest.mark.parametrize(("urdf", "sentence"), REFUSED.values(), ids=REFUSED)
def test_agent_and_gateway_refuse_a_robot_with_one_sentence(urdf: str, sentence: str, tmp_path: Path) -> None:
    by_agent, _ = read_by_agent(urdf.encode(), tmp_path)
    by_gateway = read_by_gateway(urdf, ("j1", "j2"))
    assert sentence in by_agent.refusal
    assert by_agent.refusal.endswith(by_gateway.refusal) and by_gateway.refusal


_DECLARED = '<?xml version="1.0" encoding="{}"?>\n<!-- Gerät -->\n'
_JOINTS = (("j1", True), ("j2", True))

ACCEPTED = {
    "default namespace": arm(attributes=' xmlns="http://www.ros.org"').encode(),
    "another default namespace": arm(attributes=' xmlns="http://drake.mit.edu"').encode(),
    "namespace of xacro that is not used": arm(attributes=' xmlns:xacro="http://www.ros.org/wiki/xacro"').encode(),
    "declared prefix": arm(attributes=' xmlns:x="http://x"', more='<x:y a="${b}"/>').encode(),
    "undeclared prefix of an attribute": arm(LIMIT.replace("<limit", '<limit drake:acceleration="2"')).encode(),
    "undeclared prefix of an element": arm(more='<drake:thing name="n"><drake:more/></drake:thing>').encode(),
    "expression in what others read": arm(more="<gazebo><plugin a='$(find p)/x'/></gazebo>").encode(),
    "UTF-8": arm(prolog=_DECLARED.format("UTF-8")).encode(),
    "UTF-8 with byte order mark": arm(prolog=_DECLARED.format("UTF-8")).encode("utf-8-sig"),
    "Latin-1": arm(prolog=_DECLARED.format("ISO-8859-1")).encode("latin-1"),
    "Windows": arm(prolog=_DECLARED.format("windows-1252")).encode("cp1252"),
    "Latin-1 that is not declared": arm(prolog="<!-- Gerät -->").encode("latin-1"),
    "UTF-16": arm(prolog=_DECLARED.format("UTF-16")).encode("utf-16"),
    "UTF-16 without byte order mark": arm(prolog=_DECLARED.format("UTF-16")).encode("utf-16-be"),
    "lines before the declaration": ("\n \n" + arm(prolog=_DECLARED.format("UTF-8"))).encode(),
    "hyphens in a comment": arm(prolog="<!-- a -- b ---->").encode(),
    "end of a C string": arm().encode() + b"\x00",
    "two axes": arm('<axis xyz="1 0 0"/>' + LIMIT).encode(),
    "commas between numbers": arm('<origin xyz="0, 0, 0.4"/>' + LIMIT).encode(),
    "carriage returns": arm().replace("><", ">\r\n<").encode(),
}


@pytest.mark.parametrize("content", ACCEPTED.values(), ids=ACCEPTED)
def test_agent_and_gateway_read_what_is_in_the_field(content: bytes, tmp_path: Path) -> None:
    by_agent, text = read_by_agent(content, tmp_path)
    assert by_agent.joints == _JOINTS, by_agent.refusal
    assert read_by_gateway(text, ("j1", "j2")).joints == _JOINTS
    assert np.isfinite(_in_pinocchio(text)).all() and np.isfinite(_on_pages(text)).all()


def test_the_first_of_two_axes_is_read_everywhere_and_the_second_is_reported() -> None:
    urdf = arm('<axis xyz="1 0 0"/>' + LIMIT)
    for read in (_in_resources, _in_pinocchio, _in_mujoco, _on_pages, _collision_shape_of_tool):
        assert read(urdf) == pytest.approx(read(arm()), abs=1e-9)
    assert RobotModel.parse(urdf).findings_about("joint", "j1") == [
        "Joint 'j1' has 2 elements <axis>; the first one is read."
    ]


def test_a_file_in_no_declared_encoding_is_reported(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read_by_agent(ACCEPTED["Latin-1 that is not declared"], tmp_path)
    assert any("r: robot.urdf: line 1 is not UTF-8" in message for message in caplog.messages)


@pytest.mark.parametrize(
    "name", ["joint1 ", " joint1", "a/b", "关节1", "left arm", "..", "%2F", "tab\tname", "-", "J" * 128]
)
def test_agent_and_gateway_have_one_rule_for_names(name: str, tmp_path: Path) -> None:
    """White space around a name is left out, and reported."""
    by_agent, text = read_by_agent(arm().replace('"j1"', f'"{name}"').replace("\t", "&#9;").encode(), tmp_path)
    assert by_agent.joints == ((name.strip(), True), ("j2", True)), by_agent.refusal
    assert read_by_gateway(text, (name.strip(), "j2")) == by_agent
    found = RobotModel.parse(text).findings_about("joint", name.strip())
    assert [each.endswith("white space around its name, which is left out.") for each in found] == [True] * (
        name != name.strip()
    )


XACRO = {
    "include": (arm(more='<xacro:include filename="x"/>'), "the robot contains the element <xacro:include>"),
    "macro in a link": (
        arm(upper='<xacro:inertia mass="1"/>', attributes=' xmlns:xacro="http://www.ros.org/wiki/xacro"'),
        "link 'upper' contains the element <xacro:inertia>",
    ),
    "another prefix": (
        arm(more="<x:macro/>", attributes=' xmlns:x="http://www.ros.org/wiki/xacro"'),
        "the robot contains the element <x:macro>",
    ),
    "expression": (
        arm(f'<origin rpy="0 0 ${{pi/2}}"/>{LIMIT}'),
        "joint 'j1' contains the expression '${pi/2}' (rpy of <origin>)",
    ),
    "substitution": (
        arm(upper=f'{INERTIAL}<visual><geometry><mesh filename="$(find p)/a.stl"/></geometry></visual>'),
        "link 'upper' contains the expression '$(find p)' (filename of <mesh>)",
    ),
    "name of the robot": (
        arm().replace('name="r"', 'name="${n}"'),
        "the robot contains the expression '${n}'",
    ),
}


@pytest.mark.parametrize(("urdf", "sentence"), XACRO.values(), ids=XACRO)
def test_what_xacro_left_is_refused_with_its_place(urdf: str, sentence: str, tmp_path: Path) -> None:
    by_agent, _ = read_by_agent(urdf.encode(), tmp_path)
    by_gateway = read_by_gateway(urdf, ("j1", "j2"))
    assert sentence in by_agent.refusal and by_agent.refusal.endswith(by_gateway.refusal)
    assert "xacro FILE.xacro > FILE.urdf" in by_gateway.refusal


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (arm(prolog=_DECLARED.format("UTF-8")).encode("latin-1"), "no text in its encoding UTF-8"),
        (arm(prolog=_DECLARED.format("klingon")).encode(), "encoding 'klingon', which is unknown"),
        (arm(prolog=_DECLARED.format("hex")).encode(), "encoding 'hex', which is unknown"),
        (b"\xff\xfe<", "no text in its encoding utf-16"),
        (arm(prolog="\n\n<!-- -->").replace("</robot>", "</rob>").encode(), "mismatched tag in line 3"),
        (arm().encode()[:-20], "no well-formed XML"),
    ],
)
def test_bytes_that_are_no_text_are_refused(content: bytes, sentence: str, tmp_path: Path) -> None:
    assert sentence in read_by_agent(content, tmp_path)[0].refusal


def test_a_refused_robot_is_shown_with_the_reason_and_without_joints() -> None:
    robot = described(REFUSED["version 2.0"][0], ("j1", "j2"))
    assert robot.model is None and robot.fault and "version '2.0'" in robot.fault
