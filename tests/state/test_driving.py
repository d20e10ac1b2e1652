"""The ways of bases: where a drive and a path take them."""

import math

import pytest
from msgspec.structs import replace

from linked_fleet_agent.planar import DriveLimits, Pose, Velocity
from linked_fleet_agent.smooth_path import TOLERANCE_M
from linked_fleet_state.driving import REACTION_S, Drive, FollowedPath, relative

LIMITS = DriveLimits(linear=1.0, angular=1.5, linear_acceleration=1.0, angular_acceleration=2.0)
SIDEWAYS = DriveLimits(linear=1.0, angular=1.5, linear_acceleration=1.0, angular_acceleration=2.0, lateral=0.5)
NO_HEADING = math.nan


def test_a_drive_ends_where_the_base_has_braked() -> None:
    at_once, *late = Drive(Velocity(0.5), 1.0, LIMITS).ways(Velocity(0.5, 0.0, 0.1))
    assert at_once[-1].x == pytest.approx(0.5 * 1.02 + 0.125, abs=0.015)
    assert max(way[-1].x for way in late) == pytest.approx(at_once[-1].x + 0.5 * REACTION_S, abs=0.02)


@pytest.mark.parametrize("now", [Velocity(), Velocity(0.2, 0.0, 0.4), Velocity(0.3, 0.0, 0.6)])
def test_of_ways_on_one_arc_the_longest_is_enough(now: Velocity) -> None:
    drive = Drive(Velocity(0.25, 0.0, 0.5), 1.0, LIMITS)
    (longest,) = drive.ways(now, Velocity(0.1, 0.0, 0.2))
    others = drive.ways(now, Velocity(0.1, 0.0, 0.22))
    assert len(others) > 1
    assert longest[-1].heading >= max(way[-1].heading for way in others) - 0.02
    assert all(at.heading == pytest.approx(2 * math.atan2(at.y, at.x), abs=0.03) for at in longest), "one arc"


def test_headings_of_a_drive_go_on_beyond_half_a_turn() -> None:
    way = Drive(Velocity(0.0, 0.0, 1.5), 4.0, LIMITS).ways(Velocity(0.0, 0.0, 1.5))[0]
    assert way[-1].heading > 2 * math.pi - 0.5


def test_a_share_that_fits_needs_that_share_of_the_way() -> None:
    drive = Drive(Velocity(1.0), 1.0, LIMITS)
    whole = drive.ways(Velocity(1.0))[-1][-1].x
    share = drive.fitting_share(0.5)
    slower = drive.slowed(share)
    assert slower.ways(slower.velocity)[-1][-1].x == pytest.approx(0.5 * whole, rel=0.05)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (FollowedPath((Pose(1, 0, NO_HEADING),)), [(0, 0, 0), (1, 0, 0)]),
        (FollowedPath((Pose(0, 1, NO_HEADING),)), [(0, 0, math.pi / 2), (0, 1, math.pi / 2)]),
        (FollowedPath((Pose(-1, 0, NO_HEADING),), reverse=True), [(0, 0, 0), (-1, 0, 0)]),
        (FollowedPath((Pose(1, 0, -1.0),)), [(0, 0, 0), (1, 0, 0), (1, 0, -1.0)]),
        (FollowedPath((Pose(0, 1, 0.5),), limits=SIDEWAYS), [(0, 1, 0.5), (0, 1, 0.5)]),
    ],
)
def test_a_path_turns_drives_and_turns(path: FollowedPath, said: list[tuple[float, float, float]]) -> None:
    (way,) = path.ways(Pose())
    assert [tuple(each) for each in way] == [pytest.approx(each, abs=1e-9) for each in said]


def test_a_path_is_seen_from_where_the_base_is() -> None:
    (way,) = FollowedPath((Pose(1, 2, NO_HEADING),)).ways(Pose(1, 1, math.pi / 2))
    assert way[-1] == pytest.approx((1, 0, 0), abs=1e-9)


def test_a_corner_is_also_cut() -> None:
    through, around = FollowedPath((Pose(1, 0, NO_HEADING), Pose(1, 1, NO_HEADING))).ways(Pose())
    assert (1.0, 0.0) in [(round(x, 6), round(y, 6)) for x, y, _ in through]
    near = min(math.dist((x, y), (1, 0)) for x, y, _ in around)
    assert near == pytest.approx(TOLERANCE_M * math.sqrt(2), abs=1e-6), "the chord is 5 cm from the corner"


INTO = FollowedPath((Pose(1.6, 0, 0), Pose(2, 0, 0)), docks=True)


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (Pose(), [(0, 0, 0), (1.6, 0, 0), (1.6, 0, 0), (2, 0, 0), (2, 0, 0)]),
        (Pose(1.6, -1, math.pi / 2), [(0, 0, 0), (1, 0, 0), (1, 0, -math.pi / 2)]),
        (Pose(1.9, 0, 0), [(0, 0, 0), (-0.3, 0, 0), (-0.3, 0, 0), (0.1, 0, 0), (0.1, 0, 0)]),
    ],
    ids=["from before", "from aside", "backwards from between"],
)
def test_the_way_into_a_station_stops_in_front_of_it(now: Pose, said: list[tuple[float, float, float]]) -> None:
    (way,) = INTO.ways(now)
    assert [tuple(each) for each in way[: len(said)]] == [pytest.approx(each, abs=1e-9) for each in said]
    assert way[-1] == pytest.approx(relative(Pose(2, 0, 0), now), abs=1e-9)


def test_a_base_that_drives_sideways_does_not_drive_backwards_into_a_station() -> None:
    (way,) = replace(INTO, limits=SIDEWAYS).ways(Pose(1.9, 0, 0.5))
    assert way[0].heading == pytest.approx(-0.5)
