"""The check of a path in time: another robot is met only in the places where it is at that time."""

import math

import pytest

from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.course import evenly
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CollisionFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
)
from linked_fleet_gateway.extensions.world.questions import legs_through
from linked_fleet_gateway.extensions.world.shapes import build_robot
from linked_fleet_state.model import Pose

ROD = """<robot name="rod"><link name="foot"/><link name="arm"><collision><origin xyz="0.5 0 0"/>
<geometry><box size="1 .02 .02"/></geometry></collision></link>
<joint name="turn" type="continuous"><parent link="foot"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>"""
ROBOTS = {"rod": build_robot(ROD)}
EVER = math.inf


def at(x: float, y: float) -> Pose:
    return Pose((x, y, 0.0), (0.0, 0.0, 0.0, 1.0))


HERE, ACROSS = at(0.0, 0.0), at(1.5, 0.0)
"""Two rods of 1 m stand there: if one points at the other, that meets it in the middle of a half turn."""
AWAY, IN_THE_WAY = {"turn": math.pi / 2}, {"turn": math.pi}


def go(*legs: PathSegment, places: tuple[dict[str, float], ...], times_s: tuple[tuple[float, float], ...]) -> Answer:
    """Turn a rod from -90°, with another one at places in times."""
    other = Placement("other", "rod", ACROSS, places, times_s=times_s)
    way = MotionPath({"turn": -math.pi / 2}, legs)
    return check(Check(Placement("me", "rod", HERE), (way,), (other,), (), 30.0, in_time=True), ROBOTS, {})


HALF_TURN_IN_10_S = PathSegment({"turn": math.pi / 2}, timing=evenly(10.0))
"""It is in the middle after 5 s."""


@pytest.mark.parametrize(
    ("from_s", "until_s", "met"),
    [
        (-EVER, 3.0, False),  # it has left before
        (7.0, EVER, False),  # it comes after
        (-EVER, 4.9, True),
        (5.1, EVER, True),
        (-EVER, EVER, True),
        (4.999, 5.001, True),  # between two places of the path
        (3.0, 3.1, False),
    ],
)
def test_another_robot_is_met_while_it_is_there(from_s: float, until_s: float, met: bool) -> None:
    answer = go(HALF_TURN_IN_10_S, places=(AWAY, IN_THE_WAY), times_s=((-EVER, EVER), (from_s, until_s)))
    assert isinstance(answer, CollisionFound if met else Free)
    if isinstance(answer, CollisionFound):
        assert answer.share == pytest.approx(0.5, abs=0.1) and (answer.kind, answer.name) == ("robot", "other")


def test_without_times_it_is_met_at_any_time() -> None:
    assert isinstance(go(HALF_TURN_IN_10_S, places=(AWAY, IN_THE_WAY), times_s=()), CollisionFound)


@pytest.mark.parametrize(("from_s", "met"), [(4.0, False), (-EVER, True)])
def test_the_times_of_a_path_with_ramps_are_those_of_its_ramps(from_s: float, met: bool) -> None:
    slow_at_the_end = PathSegment({"turn": math.pi / 2}, timing=((0.0, 0.0), (2.0, 0.8), (10.0, 1.0)))
    answer = go(slow_at_the_end, places=(AWAY, IN_THE_WAY), times_s=((-EVER, EVER), (from_s, EVER)))
    assert isinstance(answer, CollisionFound if met else Free)


def test_a_trajectory_is_met_at_the_times_of_its_waypoints() -> None:
    start = {"turn": -math.pi / 2}
    waits = legs_through(("turn",), (8.0, 10.0), ((-math.pi / 2,), (math.pi / 2,)), start)
    for window, met in (((4.0, 6.0), False), ((8.5, 9.5), True)):
        answer = go(*waits, places=(AWAY, IN_THE_WAY), times_s=((-EVER, EVER), window))
        assert isinstance(answer, CollisionFound if met else Free), window


def test_a_robot_stands_at_its_end_for_ever_and_at_its_start_until_it_moves() -> None:
    to_the_middle = PathSegment({"turn": 0.0}, timing=evenly(1.0))
    comes = go(to_the_middle, places=(AWAY, IN_THE_WAY), times_s=((-EVER, EVER), (60.0, EVER)))
    assert isinstance(comes, CollisionFound) and comes.share == 1.0
    stays = PathSegment({"turn": -math.pi / 2}, timing=evenly(5.0))
    comes_and_goes = ({"turn": 0.0}, {"turn": math.pi})
    other = Placement("other", "rod", at(0.5, -0.5), comes_and_goes, times_s=((-EVER, 2.0), (2.0, 3.0)))
    way = MotionPath({"turn": -math.pi / 2}, (stays, HALF_TURN_IN_10_S))
    answer = check(Check(Placement("me", "rod", HERE), (way,), (other,), (), 30.0, in_time=True), ROBOTS, {})
    assert isinstance(answer, CollisionFound) and answer.share < 0.01, "what comes while it stands must not touch it"


@pytest.mark.parametrize(("starts", "ends"), [(-0.0612, -0.0596), (-0.0596, -0.0612)])
def test_a_time_between_two_places_of_the_path_belongs_to_both(starts: float, ends: float) -> None:
    """The rod is within the margin of the other one at one end of a single step."""
    other = Placement("other", "rod", ACROSS, (AWAY, IN_THE_WAY), times_s=((-EVER, 0.1), (0.4, 0.6)))
    way = MotionPath({"turn": starts}, (PathSegment({"turn": ends}, timing=evenly(1.0)),))
    answer = check(Check(Placement("me", "rod", HERE), (way,), (other,), (), 30.0, in_time=True), ROBOTS, {})
    assert isinstance(answer, CollisionFound)


def test_a_place_to_which_the_other_robot_returns_is_met_at_both_times() -> None:
    times_s = ((-EVER, 0.5), (0.5, 2.0), (4.0, EVER))
    answer = go(HALF_TURN_IN_10_S, places=(IN_THE_WAY, AWAY, IN_THE_WAY), times_s=times_s)
    assert isinstance(answer, CollisionFound)
