"""Floating, planar and unlimited prismatic joints: what they carry may be anywhere until their positions are known."""

import math

import pytest

from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CollisionFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
    UncheckedNear,
)
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.scene import Box
from linked_fleet_gateway.extensions.world.shapes import build_object_shape, build_robot
from linked_fleet_state.model import Pose

BODY = '<collision><origin xyz="0 0 .15"/><geometry><box size=".1 .1 .3"/></geometry></collision>'


def joint(name: str, kind: str, parent: str, child: str, more: str = "", z: float = 0.4) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0 0 {z}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 1 0"/>{more}</joint>'
    )


def arm(base_joint: str, more: str = "") -> Robot:
    """Return an arm of three links of 30 cm on a joint of this kind."""
    links = "".join(f'<link name="{name}">{BODY}</link>' for name in ("base", "upper", "tool"))
    limit = '<limit lower="-3.2" upper="3.2" velocity="1" effort="50"/>'
    joints = joint("j1", "revolute", "base", "upper", limit) + joint("j2", "revolute", "upper", "tool", limit)
    carrier = joint("virtual", base_joint, "odom", "base", more).replace("0 1 0", "0 0 1")
    return build_robot(f'<robot name="r"><link name="odom"/>{links}{joints}{carrier}</robot>')


def go(robot: Robot, ends: dict[str, float], *things: float, start: dict[str, float] | None = None,
       others: tuple[Placement, ...] = (), accepts: bool = False, **robots: Robot) -> Answer:  # fmt: skip
    """Move the robot at the origin among boxes at these x."""
    objects = {f"{x}": build_object_shape(Box((0.2, 0.2, 3.0))) for x in things}
    placed = tuple(Placement(f"{x}", f"{x}", at(x)) for x in things)
    path = MotionPath({"j1": 0.0, "j2": 0.0} | (start or {}), (PathSegment(ends),))
    asked = Check(Placement("me", "me", at(0.0), (), accepts), (path,), others, placed, 30.0)
    return check(asked, {"me": robot, **robots}, objects)


def at(x: float) -> Pose:
    return Pose((x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_links_behind_a_loose_joint_are_unchecked_and_move_where_nothing_is(kind: str) -> None:
    robot = arm(kind)
    why = f"it is carried by the {kind} joint virtual, whose position is unknown"
    assert [(each.link, each.reason) for each in robot.unchecked] == [(link, why) for link in ("base", "upper", "tool")]
    assert robot.unchecked_m == math.inf
    free = go(robot, {"j1": 1.0})
    assert isinstance(free, Free) and free.covered


@pytest.mark.parametrize("kind", ["floating", "planar"])
@pytest.mark.parametrize("x", [0.5, 3.0, 20.0])
def test_a_robot_that_may_be_anywhere_is_refused_beside_anything(kind: str, x: float) -> None:
    assert go(arm(kind), {"j1": 1.0}, x) == UncheckedNear(True, "object", f"{x}")
    fixed = Placement("beside", "beside", at(x), ({"j1": 0.0, "j2": 0.0},))
    assert go(arm(kind), {"j1": 1.0}, others=(fixed,), beside=arm("fixed")) == UncheckedNear(True, "robot", "beside")


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_the_neighbour_of_a_robot_that_may_be_anywhere_is_not_told_that_the_way_is_free(kind: str) -> None:
    beside = Placement("beside", "beside", at(3.0), ({"j1": 0.0, "j2": 0.0},))
    answer = go(arm("fixed"), {"j1": 1.0}, others=(beside,), beside=arm(kind))
    assert answer == UncheckedNear(False, "robot", "beside")
    accepted = Placement("beside", "beside", at(3.0), ({"j1": 0.0, "j2": 0.0},), True)
    free = go(arm("fixed"), {"j1": 1.0}, others=(accepted,), beside=arm(kind))
    assert isinstance(free, Free) and free.unchecked == ("beside",)


@pytest.mark.parametrize("kind", ["floating", "planar", "fixed"])
def test_an_arm_on_a_loose_joint_is_checked_against_itself(kind: str) -> None:
    """The tool folds back to the base, wherever that is."""
    assert isinstance(go(arm(kind), {"j2": 1.5}, start={"j1": 2.0944}), Free)
    met = go(arm(kind), {"j2": 2.618}, start={"j1": 2.0944})
    assert isinstance(met, CollisionFound) and {met.link, met.other} == {"base", "tool"}


LIMIT = '<limit lower="-.1" upper=".1" velocity="1" effort="50"/>'


@pytest.mark.parametrize("limit", ["", '<limit velocity="1" effort="1"/>', LIMIT])
def test_a_prismatic_joint_carries_as_far_as_it_is(limit: str) -> None:
    """Its limits are none, or it is beyond them: the arm is checked where it stands."""
    slide = _slide(limit)
    start = {"virtual": 5.0}
    assert slide.unchecked == ()
    assert isinstance(go(slide, {"j1": 1.5}, 5.5, start=start), CollisionFound)
    assert isinstance(go(slide, {"j1": 1.5}, 0.5, start=start), Free)
    assert isinstance(go(slide, {"virtual": 5.0}, 5.0, start={"virtual": 0.0}), CollisionFound)
    beside = Placement("beside", "beside", at(-4.5), ({"j1": 0.0, "j2": 0.0, "virtual": 5.0},))
    assert isinstance(go(arm("fixed"), {"j1": 1.5}, others=(beside,), beside=slide), CollisionFound)


def _slide(limit: str) -> Robot:
    links = "".join(f'<link name="{name}">{BODY}</link>' for name in ("base", "upper", "tool"))
    turns = '<limit lower="-3.2" upper="3.2" velocity="1" effort="50"/>'
    joints = joint("j1", "revolute", "base", "upper", turns) + joint("j2", "revolute", "upper", "tool", turns)
    carrier = joint("virtual", "prismatic", "odom", "base", limit).replace("0 1 0", "1 0 0")
    return build_robot(f'<robot name="r"><link name="odom"/>{links}{joints}{carrier}</robot>')
