"""Which other robots the path of a robot may meet, so that it is checked among them."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.world.checks import Neighbour
from linked_fleet_gateway.extensions.world.driving import apart_m
from linked_fleet_gateway.extensions.world.path_watch import near_ones
from linked_fleet_state.driving import FollowedPath

HERE = Pose(10.0, 0.0, math.pi / 2)
AHEAD_1_M = FollowedPath((Pose(10.0, 1.0, math.nan),))
ME = Neighbour((Pose(), Pose()), 0.5)
"""Its odometry frame is turned and shifted: in the world it drives along x from the origin."""


def _near(start: Pose, end: Pose) -> bool:
    return bool(near_ones("me", HERE, AHEAD_1_M, {"me": ME, "other": Neighbour((start, end), 0.5)}))


def test_a_robot_beside_the_path_is_near_it_and_one_beyond_its_end_is_not() -> None:
    assert _near(Pose(0.5, 1.0), Pose(0.5, 1.0))
    assert not _near(Pose(0.5, 1.2), Pose(0.5, 1.2))
    assert not _near(Pose(2.2, 0.0), Pose(2.2, 0.0))


def test_a_robot_that_drives_is_near_if_its_way_comes_near() -> None:
    assert _near(Pose(0.5, 3.0), Pose(0.5, -3.0))  # it crosses the path, its ends are far
    assert _near(Pose(4.0, 0.0), Pose(2.0, 0.0))
    assert not _near(Pose(0.0, 1.2), Pose(1.0, 1.2))


def test_a_robot_at_an_unknown_place_is_near_and_all_are_near_a_robot_at_one() -> None:
    assert near_ones("me", HERE, AHEAD_1_M, {"me": ME, "lost": Neighbour(None, 0.5)}) == {"lost"}
    far = Neighbour((Pose(90.0), Pose(90.0)), 0.5)
    assert near_ones("me", HERE, AHEAD_1_M, {"me": Neighbour(None, 0.5), "far": far}) == {"far"}


places = st.builds(Pose, st.floats(-5, 5), st.floats(-5, 5))


@given(st.lists(places, min_size=2, max_size=3), st.lists(places, min_size=2, max_size=3))
def test_two_ways_are_as_far_apart_as_their_nearest_points(one: list[Pose], other: list[Pose]) -> None:
    points = [start.between(end, share / 40) for start, end in pairwise(one) for share in range(41)]
    sampled = min(at.to_leg_m(*leg) for at in points for leg in pairwise(other))
    longest = max(math.dist(start[:2], end[:2]) for start, end in pairwise(one))
    assert sampled - longest / 80 - 1e-9 <= apart_m(one, other) <= sampled + 1e-9
    assert apart_m(one, other) == pytest.approx(apart_m(other, one), abs=1e-9)
