"""Where a robot comes closest to what is around it."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.messages import (
    Check,
    ClosestFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
)
from linked_fleet_gateway.extensions.world.questions import legs_through
from linked_fleet_gateway.extensions.world.scene import Sphere
from linked_fleet_gateway.extensions.world.shapes import build_object_shape, build_robot
from linked_fleet_state.model import Pose

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LONG_M, RADIUS_M = 1.0, 0.1
ROD = build_robot(
    "<robot name='rod'><link name='foot'><collision><geometry><sphere radius='.1'/></geometry></collision></link>"
    f"<link name='arm'><collision><origin xyz='{LONG_M / 2} 0 0'/><geometry><box size='{LONG_M} .02 .02'/></geometry>"
    "</collision></link><joint name='turn' type='continuous'><parent link='foot'/><child link='arm'/>"
    "<axis xyz='0 0 1'/></joint></robot>"
)
BALL = build_object_shape(Sphere(RADIUS_M))


def asked(ball: tuple[float, float, float], turn: float, within_s: float = 5.0) -> Check:
    """Return the question about a turn of a rod of 1 m from the x axis, with a ball; the root is 1 m along x."""
    path = MotionPath({"turn": 0.0}, (PathSegment({"turn": turn}),))
    placed = Placement("ball", "ball", Pose((ball[0] + 1.0, ball[1], ball[2]), UPRIGHT))
    rod = Placement("rod", "rod", Pose((1.0, 0.0, 0.0), UPRIGHT))
    return Check(rod, (path,), (), (placed,), 10.0, closest_within_s=within_s)


def found(question: Check) -> ClosestFound:
    answer = check(question, {"rod": ROD}, {"ball": BALL})
    assert isinstance(answer, Free) and answer.closest is not None, answer
    return answer.closest


@pytest.mark.parametrize(("angle", "far_m"), [(0.4, 1.3), (0.7, 1.2), (1.1, 2.0), (1.4, 1.15)])
def test_the_least_distance_on_a_path_is_found_where_it_is(angle: float, far_m: float) -> None:
    """A rod that turns by a quarter passes a ball before its tip."""
    ball = (far_m * math.cos(angle), far_m * math.sin(angle), 0.0)
    near = found(asked(ball, math.pi / 2))
    assert near.apart_m == pytest.approx(far_m - LONG_M - RADIUS_M, rel=0.05, abs=0.001)
    assert near.uncertain_m <= max(0.001, 0.05 * near.apart_m)
    assert near.met.share == pytest.approx(angle / (math.pi / 2), abs=0.15)
    assert (near.met.link, near.met.kind, near.met.name) == ("arm", "object", "ball")
    tip, edge = np.array((math.cos(angle), math.sin(angle))), far_m - RADIUS_M
    assert near.met.point == pytest.approx((1 + tip[0] * (1 + edge) / 2, tip[1] * (1 + edge) / 2, 0.0), abs=0.08)


def test_what_stands_still_is_not_what_comes_close() -> None:
    """The ball is 1 cm from the foot and 0.19 m from the rod, which turns away from it."""
    near = found(asked((0.0, 0.0, -0.211), 1.0))
    assert near.met.link == "arm" and near.apart_m == pytest.approx(0.211 - 0.1 - 0.01, abs=0.002)


def test_a_trajectory_says_when() -> None:
    """The rod is at the ball after a quarter of its way, and waits there."""
    question = asked((1.2 * math.cos(0.4), 1.2 * math.sin(0.4), 0.0), 0.0)
    legs = legs_through(("turn",), (2.0, 10.0, 12.0), ((0.4,), (0.4,), (1.6,)), {"turn": 0.0})
    near = found(replace(question, paths=(MotionPath({"turn": 0.0}, legs),)))
    assert near.apart_m == pytest.approx(0.1, abs=0.005)
    assert near.at_s is not None and 1.5 <= near.at_s <= 10.6
    assert found(asked((2.0, 0.0, 0.0), 1.0)).at_s is None, "a direct path has no times"


def test_a_search_that_ends_early_says_how_much_nearer_it_may_be() -> None:
    ball = (1.2 * math.cos(0.7), 1.2 * math.sin(0.7), 0.0)
    hasty, exact = found(asked(ball, 1.5, within_s=1e-9)), found(asked(ball, 1.5))
    assert hasty.apart_m - hasty.uncertain_m <= exact.apart_m <= hasty.apart_m
    assert hasty.uncertain_m > exact.uncertain_m


def test_a_long_motion_has_coarser_places() -> None:
    """It swings by the ball five hundred times, 200 m in all."""
    question = asked((1.2 * math.cos(0.2), 1.2 * math.sin(0.2), 0.0), 0.0)
    rows = tuple((0.4 * (k % 2),) for k in range(1, 501))
    legs = legs_through(("turn",), tuple(float(k) for k in range(1, 501)), rows, {"turn": 0.0})
    near = found(replace(question, within_s=60.0, paths=(MotionPath({"turn": 0.0}, legs),)))
    assert near.apart_m == pytest.approx(0.1, abs=0.05)
    assert near.apart_m - near.uncertain_m <= 0.1 + 1e-6


def test_without_a_wish_or_anything_around_there_is_none() -> None:
    answer = check(replace(asked((2.0, 0.0, 0.0), 1.0), closest_within_s=0.0), {"rod": ROD}, {"ball": BALL})
    assert isinstance(answer, Free) and answer.closest is None
    alone = check(replace(asked((2.0, 0.0, 0.0), 1.0), objects=()), {"rod": ROD}, {})
    assert isinstance(alone, Free) and alone.closest is None
