"""A link is in the world at placement × base × link, for each face that says or uses where it is.

Scenes of pages draw the placement as a group with the robot in it, which the base of a frame moves.
"""

import math
from typing import Any

import msgspec
import pytest

from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Base, State
from linked_fleet_gateway.extensions.foxglove import messages as foxglove
from linked_fleet_gateway.extensions.world.placement import PLACEMENT, encode_placement, placement_of, pose_in_world
from linked_fleet_gateway.extensions.world.questions import base_of
from linked_fleet_gateway.faces import relative_pose
from linked_fleet_identity.rights import ALL
from linked_fleet_state.carried import CarriedPose
from linked_fleet_state.events import Described, Framed
from linked_fleet_state.kinematics import ORIGIN
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot

_TURN = math.sqrt(0.5)
_LEFT = (0.0, 0.0, _TURN, _TURN)
"""A quarter of a turn, counterclockwise."""
CUP = "/world/objects/cup"
HELD = {"/world": ORIGIN, CUP: CarriedPose("r", "pan_link", Pose((0.0, 0.0, 0.1), ORIGIN.orientation_xyzw))}


@pytest.fixture
def robot(bench: Any) -> Robot:
    """Return a robot 2 m along x of its odometry frame, which stands at (10, 0, 0) and looks along y of the world."""
    found: Robot = bench.robot({"pan": ("continuous", '<origin xyz="0 0 0.5"/>')}, None)
    changed = msgspec.structs.replace(found.description, base="floating", layout=layout(1, True))
    bench.fleet.apply(Described(changed), 1)
    still = (0.0, 0.0, 0.0)
    state = State(
        incarnation=found.incarnation, sequence=1, monotonic_ns=1, wall_ns=1, positions=(0.0,), velocities=(0.0,),
        efforts=(0.0,), base=Base((2.0, 0.0, 0.0), _LEFT, still, still),
    )  # fmt: skip
    bench.fleet.apply(Framed("r", encode_state(state)), 1)
    found.settings = {PLACEMENT: encode_placement(Pose((10.0, 0.0, 0.0), _LEFT), False)}
    return found


def is_at(pose: Pose | None, *position: float) -> bool:
    """Return True for a pose at a position that looks against x: turned twice to the left."""
    assert pose is not None
    looks = abs(pose.orientation_xyzw[2])
    return pose.position_m == pytest.approx(position, abs=1e-6) and looks == pytest.approx(1.0)


def test_its_links_move_with_its_base_in_every_face(robot: Robot) -> None:
    assert is_at(pose_in_world(robot, "base"), 10.0, 2.0, 0.0)
    assert is_at(pose_in_world(robot, "pan_link"), 10.0, 2.0, 0.5)
    assert is_at(base_of(robot, ALL), 10.0, 2.0, 0.0), "the collision check"
    assert is_at(foxglove.link_poses(robot, placement_of(robot))["pan_link"], 10.0, 2.0, 0.5), "Foxglove"
    asked = relative_pose("/r/pan_link", "/world", {"r": robot}, {"/world": ORIGIN})
    assert is_at(asked.pose, 10.0, 2.0, 0.5), "/world/pose"
    asked = relative_pose(CUP, "/world", {"r": robot}, HELD)
    assert is_at(asked.pose, 10.0, 2.0, 0.6) and asked.involves_robot, "what a link holds"


def test_what_a_link_holds_has_a_place_in_the_robot_without_a_placement(robot: Robot) -> None:
    """Its place in the world is unknown, as it is if nobody may know of the robot."""
    robot.settings = {}
    in_robot = relative_pose(CUP, "/r/base", {"r": robot}, HELD).pose
    assert in_robot is not None and in_robot.position_m == pytest.approx((0.0, 0.0, 0.6), abs=1e-6)
    seen = relative_pose("/r/base", CUP, {"r": robot}, HELD).pose
    assert seen is not None and seen.position_m == pytest.approx((0.0, 0.0, -0.6), abs=1e-6)
    assert relative_pose(CUP, "/world", {"r": robot}, HELD).pose is None
    assert relative_pose(CUP, "/world", {}, HELD).pose is None
