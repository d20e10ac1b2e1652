"""The boxes of the map near a robot: as if all of them were checked whole."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.map_obstacles import MOST_NEAR, MapObstacles
from linked_fleet_gateway.extensions.world.messages import (
    Check,
    CheckFailed,
    CollisionFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
    PrepareMap,
)
from linked_fleet_gateway.extensions.world.path import UnknownPosition
from linked_fleet_gateway.extensions.world.shapes import build_robot
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import se3
from linked_fleet_state.model import Pose

_FOOT = '<link name="foot"/>'
_ARM = (
    '<link name="arm"><collision><origin xyz="0.5 0 0"/><geometry><box size="1 .02 .02"/></geometry></collision></link>'
)
_TURN = (
    '<joint name="turn" type="continuous"><parent link="foot"/><child link="arm"/><origin xyz="0 0 0.5"/>'
    '<axis xyz="0 0 1"/></joint>'
)
ROD = build_robot(f"<robot name='rod'>{_FOOT}{_ARM}{_TURN}</robot>")


def obstacles(*boxes: tuple[int, int, int, int], origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> MapObstacles:
    cells = np.array(boxes, dtype="<u2").reshape(-1, 4)
    return MapObstacles(PrepareMap("map", cells.tobytes(), 0.1, origin, 2.0))


def go(around: MapObstacles, base: Pose, end: float) -> object:
    way = MotionPath({"turn": 0.0}, (PathSegment({"turn": end}),))
    asked = Check(Placement("me", "rod", base), (way,), (), (), 30.0, "map")
    return check(asked, {"rod": ROD}, {}, {"map": around})


def stands(x: float, y: float, heading: float = 0.0, z: float = 0.0) -> Pose:
    return Pose((x, y, z), (0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)))


def test_the_place_of_a_collision_is_in_the_world_also_with_a_turned_map() -> None:
    """A cell at x 0.5 m, y 0.8 m of a map that is turned to the left by a quarter, about (10, 0)."""
    around = obstacles((5, 8, 1, 1), origin=(10.0, 0.0, math.pi / 2))
    met = go(around, stands(10.0, 0.55), math.tau)
    assert isinstance(met, CollisionFound) and (met.kind, met.link, met.name) == ("map", "arm", "")
    assert met.point == pytest.approx((10.0 - 0.85, 0.55, 0.5), abs=0.07)
    assert met.share == pytest.approx(0.5, abs=0.05)


def _depth(point: Array, low: ArrayLike, high: ArrayLike) -> float:
    """How deep a point is in a box: negative outside."""
    return float(np.minimum(point - np.asarray(low), np.asarray(high) - point).min())


@given(st.floats(-3, 23), st.floats(-3, 3), st.floats(-4, 4), st.floats(0.0, 3.0))
def test_boxes_near_a_robot_are_those_that_it_can_reach(x: float, y: float, heading: float, reach_m: float) -> None:
    """Whatever is within the reach is in a box, and lies in it as deep as in the whole one."""
    around = obstacles((0, 0, 200, 1), (50, 5, 1, 10), (60, 5, 30, 2), origin=(0.0, 0.0, 0.3))
    root = se3(stands(x, y, heading, 0.5))
    found = list(around.near(root, reach_m))
    rng = np.random.default_rng(1)
    frame = se3(stands(0.0, 0.0, 0.3))
    for point in rng.uniform(-reach_m, reach_m, (200, 3)):
        if np.linalg.norm(point) > reach_m:
            continue
        seen = frame.inverse().act(root.act(point))
        whole = max(_depth(seen, (lx, ly, 0.0), (hx, hy, 2.0)) for lx, ly, hx, hy in around.plans)
        if abs(whole) < 1e-9:
            continue  # on the surface, where rounding decides
        near = (_depth(at.actInv(point), -box.halfSide, box.halfSide) for box, at in found)
        assert (whole > 0) == (max(near, default=-1.0) > 0)
    for box, _ in found:
        assert max(np.array(box.halfSide)[:2]) <= reach_m + 1.0


def test_a_robot_above_the_walls_meets_none() -> None:
    around = obstacles((0, 0, 20, 20))
    assert isinstance(go(around, stands(1.0, 1.0, z=1.6), math.tau), Free)
    assert not list(around.near(se3(stands(1.0, 1.0, z=5.0)), 2.0))


def test_a_robot_that_stands_in_an_occupied_place_can_leave_it() -> None:
    """As out of a zone: a map that has the robot itself in it does not keep it still for ever."""
    around = obstacles((5, 0, 5, 3))
    assert isinstance(go(around, stands(0.0, 0.15), math.pi / 2), Free)
    assert isinstance(go(around, stands(0.0, -0.2), math.pi / 2), CollisionFound)


def test_a_map_that_the_process_does_not_have_makes_the_answer_unknown() -> None:
    way = MotionPath({"turn": 0.0}, (PathSegment({"turn": 1.0}),))
    asked = Check(Placement("me", "rod", stands(0, 0)), (way,), (), (), 30.0, "map")
    assert isinstance(check(asked, {"rod": ROD}, {}, {}), CheckFailed)


def test_more_boxes_near_a_robot_than_can_be_checked_make_the_answer_unknown() -> None:
    cells = [(2 * i, 2 * j, 1, 1) for i in range(100) for j in range(100)]
    with pytest.raises(UnknownPosition, match="boxes of the map"):
        list(obstacles(*cells).near(se3(stands(10, 10)), 20.0))
    assert len(cells) > MOST_NEAR
    failed = go(obstacles(*cells), stands(10.05, 10.05), 1.0)
    assert isinstance(failed, Free | CollisionFound)  # those within its reach are few


def test_of_many_boxes_a_motion_is_checked_against_those_within_reach_alone() -> None:
    random = np.random.default_rng(1)
    cells = np.column_stack((random.integers(0, 4000, (20_000, 2)), random.integers(1, 4, (20_000, 2))))
    around = MapObstacles(PrepareMap("map", cells.astype("<u2").tobytes(), 0.05, (-100.0, -100.0, 0.0), 2.0))
    counts = [len(list(around.near(se3(stands(float(x), 0.0)), 1.5))) for x in range(-50, 50)]
    assert 0 < max(counts) < 20
