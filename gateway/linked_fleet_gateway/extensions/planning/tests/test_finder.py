"""Paths round what is in the way, judged by the collision check."""

import numpy as np
import pytest
from msgspec.structs import replace

from linked_fleet_gateway.extensions.planning.finder import find
from linked_fleet_gateway.extensions.planning.messages import BlockedAt, FindPath, NotFound, PathFound
from linked_fleet_gateway.extensions.planning.tests.arms import (
    ACCELERATION,
    BOUNDS,
    CORNER,
    JOINTS,
    ROBOTS,
    SPEED,
    STRETCHED,
    UPRIGHT,
    Room,
    joints,
    wall,
)
from linked_fleet_gateway.extensions.planning.timing import SMOOTHING_S
from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.messages import Answer, CollisionFound, Free, HeldObject
from linked_fleet_gateway.extensions.world.questions import legs_through, waypoint_velocities
from linked_fleet_gateway.extensions.world.scene import Box
from linked_fleet_gateway.extensions.world.shapes import build_object_shape
from linked_fleet_state.model import Pose

POST = Room(post=wall(0.8, 0.5))
TURNED = joints(CORNER, 0.0, 0.0)


def judged(room: Room, asked: FindPath, found: PathFound) -> Answer:
    """Return what the collision check says about the curve through the waypoints."""
    legs = legs_through(found.joints, found.times_s, found.positions, asked.around.paths[0].start)
    around = replace(asked.around, paths=(replace(asked.around.paths[0], legs=legs),))
    return check(around, ROBOTS, room.shapes)


def path(room: Room, asked: FindPath) -> PathFound:
    found = find(asked, ROBOTS, room.shapes, {})
    assert isinstance(found, PathFound), found
    return found


def test_a_post_in_the_way_is_passed() -> None:
    asked = POST.path(STRETCHED, TURNED)
    assert isinstance(check(asked.around, ROBOTS, POST.shapes), CollisionFound)
    found = path(POST, asked)
    assert isinstance(judged(POST, asked, found), Free)
    assert dict(zip(found.joints, found.positions[-1], strict=True)) == pytest.approx(TURNED, abs=1e-6)
    assert found.length > found.direct


@pytest.mark.parametrize("seed", range(5))
def test_a_path_keeps_to_speeds_and_positions(seed: int) -> None:
    asked = replace(POST.path(STRETCHED, TURNED), seed=1000 * seed)
    found = path(POST, asked)
    times = np.array((0.0, *found.times_s))
    rows = np.array((tuple(STRETCHED[name] for name in found.joints), *found.positions))
    for column in rows.T:
        speeds = np.array(waypoint_velocities(times.tolist(), column.tolist()))
        assert np.abs(speeds).max() <= SPEED * (1 + 1e-6)
        assert np.abs(np.diff(speeds) / np.diff(times)).max() <= 1.5 * ACCELERATION
    assert np.abs(rows).max() <= 3.0


def test_without_anything_in_the_way_the_path_is_straight_and_takes_its_time() -> None:
    """A turn by a quarter at 1.5 rad/s, with ramps of 0.4 s, which begin and end smoothly."""
    found = path(Room(), Room().path(STRETCHED, TURNED))
    assert found.length == pytest.approx(found.direct)
    assert found.times_s[-1] == pytest.approx(CORNER / SPEED + 0.4 + SMOOTHING_S, rel=0.03)
    assert found.tries == 1


@pytest.mark.parametrize("apart", [0.0, 1e-9])
def test_the_way_to_where_the_arm_stands_has_no_length(apart: float) -> None:
    goal = {name: position + apart for name, position in STRETCHED.items()}
    found = path(Room(), Room().path(STRETCHED, goal))
    assert found.length == 0.0
    assert dict(zip(found.joints, found.positions[-1], strict=True)) == pytest.approx(goal)


def test_the_same_seed_finds_the_same_path() -> None:
    """Of one search; how many compete depends on the time that they take."""
    asked = POST.path(STRETCHED, TURNED)
    one, other = path(POST, asked), path(POST, asked)
    assert one.joints == other.joints == JOINTS
    assert one.positions[-1] == pytest.approx(other.positions[-1])


def test_a_goal_in_an_object_is_named() -> None:
    room = Room(crate=wall(0.0, 1.0))
    found = find(room.path(STRETCHED, TURNED), ROBOTS, room.shapes, {})
    assert isinstance(found, BlockedAt)
    assert (found.place, found.by.kind, found.by.name, found.by.link) == ("goal", "object", "crate", "hand")


def test_another_goal_is_taken_if_one_is_blocked() -> None:
    room = Room(crate=wall(0.0, 1.0))
    found = path(room, room.path(STRETCHED, TURNED, joints(-CORNER, 0.0, 0.0)))
    assert found.positions[-1] == pytest.approx((-CORNER, 0.0, 0.0), abs=1e-6)


def test_a_goal_in_the_arm_itself_is_blocked() -> None:
    found = find(Room().path(STRETCHED, joints(0.0, 2.95, 2.95)), ROBOTS, {}, {})
    assert isinstance(found, BlockedAt) and found.by.kind == "self"


def test_a_goal_behind_walls_is_not_found_in_time() -> None:
    """Walls on both sides begin so near the shoulder that the upper arm cannot pass."""
    room = Room(left=wall(0.0, 0.8, 0.04, 1.4), right=wall(0.0, -0.8, 0.04, 1.4))
    found = find(room.path(STRETCHED, joints(2.6, 0.0, 0.0), within_s=0.3), ROBOTS, room.shapes, {})
    assert isinstance(found, NotFound)


def test_an_arm_that_begins_beside_a_wall_moves_away_from_it() -> None:
    """It is nearer than the clearance of paths, and does not come nearer."""
    beside = Room(wall=wall(0.8, -0.029 - 0.05, 1.0, 0.1), post=wall(0.8, 0.5))
    asked = beside.path(STRETCHED, TURNED)
    found = path(beside, asked)
    assert isinstance(judged(beside, asked, found), Free)


def test_an_arm_that_begins_beside_walls_keeps_its_distance_from_each() -> None:
    """Its upper arm is nearer to one than its hand is to the other."""
    near = wall(0.2, -0.02 - 0.002 - 0.05, 0.3, 0.1)
    less_near = wall(1.0, -0.02 - 0.008 - 0.05, 0.3, 0.1)
    beside = Room(near=near, less_near=less_near, post=wall(0.8, 0.5))
    asked = beside.path(STRETCHED, TURNED)
    assert isinstance(judged(beside, asked, path(beside, asked)), Free)


def test_an_arm_that_begins_ahead_of_a_corner_leaves_it() -> None:
    """What is larger by the clearance of paths has corners that are further out, in one of which the hand begins."""
    beside = Room(corner=wall(1.17 + 0.0105 + 0.05, 0.02 + 0.0105 + 0.05), post=wall(0.8, -0.5))
    asked = beside.path(STRETCHED, joints(-CORNER, 0.0, 0.0))
    assert isinstance(judged(beside, asked, path(beside, asked)), Free)


def test_an_arm_ends_as_near_to_a_wall_as_the_check_allows() -> None:
    beside = Room(wall=wall(-0.02 - 0.0106 - 0.05, 0.8, 0.1, 0.6), post=wall(0.8, 0.5))
    asked = beside.path(STRETCHED, TURNED)
    assert isinstance(judged(beside, asked, path(beside, asked)), Free)


def test_an_arm_without_a_path_is_told_what_is_near_its_start() -> None:
    walls = {"left": wall(0.0, 0.8, 0.04, 1.4), "right": wall(0.0, -0.8, 0.04, 1.4)}
    room = Room(**walls, post=wall(0.9, 0.02 + 0.005 + 0.03, 0.06, 0.06))
    found = find(room.path(STRETCHED, joints(2.6, 0.0, 0.0), within_s=0.3), ROBOTS, room.shapes, {})
    assert isinstance(found, BlockedAt) and found.place == "start", found
    assert (found.by.link, found.by.name, found.by.share) == ("hand", "post", 0.0)


def test_joints_that_do_not_move_stay_where_they_are() -> None:
    room = Room(post=wall(0.3, 0.28, 0.06, 0.06))
    start = joints(0.0, 1.2, -1.2)
    asked = replace(room.path(start, {"shoulder": 1.0}), bounds={"shoulder": BOUNDS["shoulder"]})
    found = find(asked, ROBOTS, room.shapes, {})
    assert isinstance(found, BlockedAt | NotFound), "one joint alone cannot pass a post"


BAR = HeldObject("bar", "bar", "hand", Pose((0.5, 0.0, 0.0), UPRIGHT), ("lower", "hand"))
"""A bar that the hand holds: it reaches 1.6 m from the root, 40 cm further than the hand."""


def holding(room: Room, asked: FindPath) -> FindPath:
    """Return the question for an arm that holds a bar."""
    room.shapes["bar"] = build_object_shape(Box((0.6, 0.04, 0.04)))
    robot = replace(asked.around.robot, holds=(BAR,))
    return replace(asked, around=replace(asked.around, robot=robot))


def test_a_path_with_a_long_bar_does_not_take_the_way_that_is_free_without_it() -> None:
    """The post is out of reach of the arm, whose path is straight, and within reach of the bar."""
    room = Room(post=wall(0.99, 0.99))
    free = room.path(STRETCHED, TURNED)
    alone = path(room, free)
    assert alone.length == pytest.approx(alone.direct)
    asked = holding(room, free)
    assert isinstance(judged(room, asked, alone), CollisionFound)
    found = path(room, asked)
    assert found.length > 1.1 * found.direct
    assert isinstance(judged(room, asked, found), Free)


def test_a_goal_at_which_a_held_object_meets_something_is_blocked_by_it() -> None:
    room = Room(crate=wall(0.0, 1.5))
    found = find(holding(room, room.path(STRETCHED, TURNED)), ROBOTS, room.shapes, {})
    assert isinstance(found, BlockedAt)
    assert (found.by.held, found.by.link, found.by.name) == ("bar", "hand", "crate")


def test_a_hand_may_end_at_what_it_may_touch() -> None:
    room = Room(crate=wall(0.0, 1.2))
    asked = room.path(STRETCHED, TURNED)
    assert isinstance(find(asked, ROBOTS, room.shapes, {}), BlockedAt)
    asked = replace(asked, around=replace(asked.around, may_touch=("crate",), hand=("hand",)))
    assert isinstance(judged(room, asked, path(room, asked)), Free)
