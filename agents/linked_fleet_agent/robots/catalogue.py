"""Robots by name: demonstration models of a catalogue, URDF files, and ROS 2 robots.

MuJoCo and the packages for ROS 2 are imported only when a robot needs them.
"""

import math
import sysconfig
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from linked_fleet_agent.components.kinds import Station
from linked_fleet_agent.mesh_files import NO_ROOTS, MeshRoots, mesh_files
from linked_fleet_agent.planar import Differential, DriveLimits
from linked_fleet_agent.robot import Facts, JointFacts, Robot
from linked_fleet_agent.robots.camera_client import probe, with_availability
from linked_fleet_agent.robots.parts import (
    NO_PARTS,
    BasePart,
    BatteryPart,
    FingersPart,
    LegsPart,
    Parts,
    ToolPart,
    corners_of,
)
from linked_fleet_agent.robots.ros2.address import SCHEMES, Address, AddressError, parse_address
from linked_fleet_agent.robots.trot import Leg
from linked_fleet_agent.urdf import RobotModel, UrdfError, decode, joints_of
from linked_fleet_agent.urdf.cutting import without
from linked_fleet_agent.urdf.writer import plain_urdf
from linked_fleet_agent.wire.keys import escape
from linked_fleet_agent.wire.messages import Camera

_ROBOTS = Path("cmeel.prefix", "share", "example-robot-data", "robots")


class UnavailableError(Exception):
    """A robot that cannot be loaded; the message says what is missing and how to get it."""


class AwayError(UnavailableError):
    """A robot that does not answer over the network, and may come at any time."""


@dataclass(frozen=True)
class Model:
    """A demonstration robot: its file in example-robot-data, its title, its pose at the start (rad or m; others 0).

    ``poses`` are further named poses, which may omit joints. ``cut_at`` names joints at which the file is cut, so that
    the robot lacks all that hangs on them.
    """

    file: str
    title: str
    comment: str
    home: Mapping[str, float] = field(default_factory=dict)
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    floating: bool = False
    home_height_m: float = 0.0
    cameras: tuple[Camera, ...] = ()
    parts: Parts = NO_PARTS
    cut_at: tuple[str, ...] = ()


def _legs(hip_rad: float, thigh_rad: float, calf_rad: float) -> dict[str, float]:
    pose: dict[str, float] = {}
    for leg, side in (("FL", 1), ("FR", -1), ("RL", 1), ("RR", -1)):
        pose |= {f"{leg}_hip_joint": side * hip_rad, f"{leg}_thigh_joint": thigh_rad, f"{leg}_calf_joint": calf_rad}
    return pose


def _baxter_arms(*values_rad: float) -> dict[str, float]:
    """Return a pose of both arms from values s0 to w2 of the left arm; the right one is its mirror image."""
    pose: dict[str, float] = {}
    for joint, mirrored, value in zip(("s0", "s1", "e0", "e1", "w0", "w1", "w2"), (1, 0) * 4, values_rad, strict=False):
        pose |= {f"left_{joint}": value, f"right_{joint}": -value if mirrored else value}
    return pose


def _baxter_fingers(side: str) -> FingersPart:
    joints = (f"{side[0]}_gripper_l_finger_joint", f"{side[0]}_gripper_r_finger_joint")
    return FingersPart(f"{side}_fingers", f"{side.capitalize()} gripper", f"{side}_gripper_base_link", joints)


def _camera(name: str, link: str, orientation_xyzw: tuple[float, float, float, float] = (0, 0, 0, 1)) -> Camera:
    """Return a small colour and depth camera with a vertical field of view of 60° and a range of 0.05 m to 20 m."""
    return Camera(
        name=name,
        link=link,
        orientation_xyzw=orientation_xyzw,
        width=320,
        height=240,
        vertical_fov_rad=1.0472,
        near_m=0.05,
        far_m=20.0,
    )


_PMB2 = BasePart(
    "Base",
    "base_footprint",
    DriveLimits(linear=1.0, angular=1.5, linear_acceleration=1.0, angular_acceleration=2.0),
    corners_of(radius=0.275),
    Differential(radius=0.0985, separation=0.4044),
    ("wheel_left_joint", "wheel_right_joint"),
    resistance_n=30.0,
)
"""The base of TIAGo."""


def _with_station(x: float, y: float, heading: float) -> BasePart:
    return replace(_PMB2, stations=(Station("charger", x, y, heading),))


_GO2 = LegsPart(
    "Legs",
    "base",
    DriveLimits(linear=0.4, angular=0.8, linear_acceleration=1.0, angular_acceleration=2.0, lateral=0.2),
    ((0.36, -0.2), (0.36, 0.2), (-0.36, 0.2), (-0.36, -0.2)),
    tuple(
        Leg(name, (0.1934 * ahead, 0.0465 * left), 0.0955 * left, thigh=0.213, calf=0.213, phase=phase)
        for name, ahead, left, phase in (("FL", 1, 1, 0.0), ("FR", 1, -1, 0.5), ("RL", -1, 1, 0.5), ("RR", -1, -1, 0.0))
    ),
)

MODELS: Mapping[str, Model] = {
    "baxter": Model(
        "baxter_description/urdf/baxter.urdf",
        "Baxter, a two-armed robot",
        "Two arms of seven joints with parallel grippers, and a head that pans.",
        {
            f"{arm}_{joint}": value
            for arm in ("left", "right")
            for joint, value in (("s1", -0.55), ("e1", 0.75), ("w1", 1.26))
        },
        {"untucked": _baxter_arms(-0.08, -1.0, -1.19, 1.94, 0.67, 1.03, -0.5)},
        cameras=(
            _camera("head", "head_camera_link", (0, 0, 1, 0)),  # mounted upside down
            _camera("left_hand", "left_hand_camera_axis_link"),
            _camera("right_hand", "right_hand_camera_axis_link"),
        ),
        parts=Parts(fingers=(_baxter_fingers("left"), _baxter_fingers("right"))),
    ),
    "ur5": Model(
        "ur_description/urdf/ur5_robot.urdf",
        "UR5, a six-axis arm",
        "A light industrial arm of six revolute joints.",
        {"shoulder_lift_joint": -1.5708, "elbow_joint": 1.5708, "wrist_1_joint": -1.5708, "wrist_2_joint": -1.5708},
        {
            "upright": {
                "shoulder_pan_joint": 0.0,
                "shoulder_lift_joint": -1.5708,
                "elbow_joint": 0.0,
                "wrist_1_joint": -1.5708,
                "wrist_2_joint": 0.0,
                "wrist_3_joint": 0.0,
            }
        },
        parts=Parts(tool=ToolPart("Tool connector", "tool0")),
    ),
    "panda": Model(
        "panda_description/urdf/panda.urdf",
        "Panda, a seven-axis arm with a gripper",
        "A seven-axis arm; the second finger of its gripper mimics the first.",
        {
            "panda_joint2": -0.785398,
            "panda_joint4": -2.35619,
            "panda_joint6": 1.5707,
            "panda_joint7": 0.785398,
            "panda_finger_joint1": 0.001,
            "panda_finger_joint2": 0.001,
        },
        {
            "upright": {
                "panda_joint1": 0.0,
                "panda_joint2": 0.0,
                "panda_joint3": 0.0,
                "panda_joint4": -0.1,
                "panda_joint5": 0.0,
                "panda_joint6": 1.5707,
                "panda_joint7": 0.785398,
            },
            "open": {"panda_finger_joint1": 0.04},
        },
        cameras=(_camera("hand", "panda_hand"),),
        parts=Parts(
            fingers=(FingersPart("gripper", "Gripper", "panda_hand", ("panda_finger_joint1", "panda_finger_joint2")),)
        ),
    ),
    "tiago": Model(
        "tiago_description/robots/tiago.urdf",
        "TIAGo, a mobile manipulator",
        "A wheeled base, a torso that lifts, one arm and a five-fingered hand.",
        {"torso_lift_joint": 0.15, "arm_1_joint": 0.5, "arm_2_joint": -0.5, "arm_4_joint": 1.2},
        {
            "folded": {
                "torso_lift_joint": 0.15,
                "arm_1_joint": 0.2,
                "arm_2_joint": -1.34,
                "arm_3_joint": -0.2,
                "arm_4_joint": 1.94,
                "arm_5_joint": -1.57,
                "arm_6_joint": 1.37,
                "arm_7_joint": 0.0,
            }
        },
        floating=True,
        cameras=(_camera("head", "xtion_rgb_optical_frame"),),
        parts=Parts(
            base=_with_station(-1.2, 0.0, math.pi),
            battery=BatteryPart(capacity_wh=720.0, idle_w=60.0, charger_w=300.0),
        ),
    ),
    "pmb2": Model(
        "tiago_description/robots/tiago.urdf",
        "PMB-2, a transport base",
        "The wheeled base of TIAGo without torso and arm. Its top is flat and can carry a box.",
        floating=True,
        parts=Parts(
            base=_with_station(1.2, 0.0, 0.0),
            battery=BatteryPart(capacity_wh=720.0, idle_w=40.0, charger_w=300.0),
        ),
        cut_at=("torso_fixed_joint", "torso_fixed_column_joint"),
    ),
    "go2": Model(
        "go2_description/urdf/go2.urdf",
        "Go2, a walking robot with four legs",
        "A quadruped of twelve joints that walks over the ground by an own trot.",
        _legs(0.068, 0.785, -1.44),
        {"crouched": _legs(0.068, 1.1, -2.1)},
        floating=True,
        home_height_m=0.335,
        parts=Parts(legs=_GO2, battery=BatteryPart(capacity_wh=236.0, idle_w=60.0, charger_w=250.0)),
    ),
}


def load(name: str, source: str, floating: bool = False, roots: MeshRoots = NO_ROOTS) -> Robot:
    """Create the robot ``name`` from ``source``: a catalogue name, the path of a URDF file, or a ``ros2:`` address.

    ``floating`` makes the base of a file a free joint. ``roots`` are further folders of meshes. Raises
    UnavailableError if the file, the package or MuJoCo is missing or the file cannot be simulated, AwayError if the
    robot does not answer.
    """
    if source.startswith(SCHEMES):
        return _find(name, source, floating, roots)
    model = MODELS.get(source)
    if model is not None:
        return _simulate(name, model, data_folder() / model.file, roots)
    path = Path(source)
    if path.suffix != ".urdf" and not path.exists():
        raise UnavailableError(f"{source!r} is neither one of {', '.join(MODELS)} nor a .urdf file")
    return _simulate(
        name, Model(source, name, f"Described by {path.name}.", floating=floating, home_height_m=0.5), path, roots
    )


def data_folder() -> Path:
    """Return the robots folder of example-robot-data. Raises UnavailableError if it is not installed."""
    for scheme in ("purelib", "platlib"):
        folder = Path(sysconfig.get_path(scheme)) / _ROBOTS
        if folder.is_dir():
            return folder
    raise UnavailableError("the package example-robot-data is missing: pip install 'linked-fleet-agent[sim]'")


def urdf_of(model: Model, text: str, name: str) -> str:
    """Return the description of a model from the text of its file. Raises UrdfError."""
    if not model.cut_at:
        return text
    try:
        return plain_urdf(without(RobotModel.parse(text), model.cut_at, name))
    except KeyError as error:
        raise UrdfError(f"it has no joint {error}, at which this robot is cut out of it") from error


def facts_of(model: Model, urdf: str) -> Facts:
    """Return the facts of a model from the text of its file. Raises UrdfError."""
    wheels = () if model.parts.base is None else model.parts.base.wheels
    joints = tuple(replace(joint, passive=joint.passive or joint.name in wheels) for joint in joints_of(urdf))
    return Facts(model.title, urdf, joints, model.floating, _annotations(model, joints))


def poses_of(model: Model, joints: Sequence[JointFacts]) -> dict[str, dict[str, float]]:
    """Return the named poses in rad or m, within limits: "home" (the pose at the start) and those of the model.

    Continuous joints, such as wheels, are left out of home. A plain URDF file has no poses.
    """
    commanded = {joint.name: joint.limits for joint in joints if joint.mimics is None and not joint.continuous}
    home = {"home": {name: model.home.get(name, 0.0) for name in commanded}} if model.home else {}
    poses = {**home, **model.poses}
    return {title: {name: commanded[name].clamp(at) for name, at in pose.items()} for title, pose in poses.items()}


def awaited(name: str, source: str, floating: bool = False) -> bool:
    """Return True for a robot that is found over the network, and so may be away.

    Raises UnavailableError if its address is wrong, or its driver is not installed.
    """
    if not source.startswith(SCHEMES):
        return False
    _address(name, source, floating)
    _ros2_driver()
    return True


def _address(name: str, source: str, floating: bool) -> Address:
    if floating:
        raise UnavailableError(f"{name}: joint states have no pose of a floating base; leave out `floating`")
    try:
        return parse_address(source)
    except AddressError as error:
        raise UnavailableError(f"{name}: {error}") from error


def _ros2_driver() -> Callable[..., Robot]:
    try:
        from linked_fleet_agent.robots.ros2.robot import Ros2Robot
    except ImportError as error:
        raise UnavailableError(
            f"robots of ROS 2 need rosbags ({error}): pip install 'linked-fleet-agent[ros]'"
        ) from error
    return Ros2Robot.find


def _find(name: str, source: str, floating: bool, roots: MeshRoots) -> Robot:
    address, find = _address(name, source, floating), _ros2_driver()
    try:
        return find(name, address, roots=roots)
    except (ConnectionError, TimeoutError) as error:
        raise AwayError(f"{name}: {error}") from error
    except AddressError as error:
        raise UnavailableError(f"{name}: {error}") from error


def _simulate(name: str, model: Model, path: Path, roots: MeshRoots) -> Robot:
    sight = probe() if model.cameras else None  # runs while MuJoCo is imported, which takes as long
    try:
        from linked_fleet_agent.robots.mujoco_robot import MujocoRobot
    except ImportError as error:
        raise UnavailableError(
            f"simulated robots need MuJoCo ({error}): pip install 'linked-fleet-agent[sim]'"
        ) from error
    try:
        facts = facts_of(model, urdf_of(model, decode(path.read_bytes(), f"{name}: {path.name}"), name))
        facts = replace(facts, meshes=mesh_files(facts.urdf, path, roots, name))
        way, reason = ("", "") if sight is None else sight.result
        facts = replace(facts, cameras=with_availability(model.cameras, reason))
        return MujocoRobot(name, facts, model.home, model.home_height_m, path, way, model.parts)
    except OSError as error:
        raise UnavailableError(f"{name}: {path} cannot be read: {error.strerror}") from error
    except UrdfError as error:
        raise UnavailableError(f"{name}: {path} is not a URDF: {error}") from error
    except ValueError as error:
        raise UnavailableError(str(error)) from error


def _annotations(model: Model, joints: Sequence[JointFacts]) -> str:
    """Return Turtle in which the relative IRI <> is the robot (R1.12) and <name> its joint."""
    lines = [
        "@prefix dcterms: <http://purl.org/dc/terms/> .",
        "@prefix lf: <https://w3id.org/linked-fleet#> .",
        "@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .",
        "@prefix unit: <http://qudt.org/vocab/unit/> .",
        "@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .",
        f"<> rdfs:comment {_literal(model.comment)}@en ;\n   dcterms:source {_literal(Path(model.file).name)} .",
    ]
    units = {joint.name: "M" if joint.linear else "RAD" for joint in joints}
    for title, pose in poses_of(model, joints).items():
        targets = ",\n     ".join(
            f"[ lf:ofJoint <{escape(name)}> ; vom:numericalValue {position!r} ; vom:unit unit:{units[name]} ]"
            for name, position in pose.items()
        )
        if targets:
            lines.append(f"<> lf:namedPose [ dcterms:title {_literal(title)} ; lf:target\n     {targets} ] .")
    return "\n".join(lines) + "\n"


def _literal(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\r", "\\r")
    return f'"{escaped}"'
