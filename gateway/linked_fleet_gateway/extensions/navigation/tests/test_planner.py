"""Ways round obstacles: they keep off everything, lead where they should, or what blocks them is named."""

import math
import random
from collections.abc import Sequence

import numpy as np
import pytest

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.navigation.messages import (
    EDGE,
    MAP,
    AsideOf,
    Blocked,
    FloorCells,
    Near,
    Obstacle,
    PlanWay,
    Polygon,
    Strip,
    TooFar,
    ToPose,
    Way,
)
from linked_fleet_gateway.extensions.navigation.planner import plan
from linked_fleet_gateway.extensions.navigation.swept import meets, swept

LONG: Polygon = ((0.5, -0.2), (0.5, 0.2), (-0.5, 0.2), (-0.5, -0.2))
START = Pose(0.0, 0.0, 0.0)


def box(x: float, y: float, half_x: float, half_y: float) -> Polygon:
    return ((x + half_x, y - half_y), (x + half_x, y + half_y), (x - half_x, y + half_y), (x - half_x, y - half_y))


def obstacle(name: str, *polygons: Polygon) -> Obstacle:
    return Obstacle(name, polygons)


def way_of(asked: PlanWay) -> Way:
    found = plan(asked)
    assert isinstance(found, Way), found
    narrow = tuple((x * 0.85, y * 0.85) for x, y in asked.outline)  # what is swept has a margin
    covered = list(swept(narrow, asked.start, found.poses, asked.lateral))
    for each in asked.obstacles:
        assert not any(meets(one, other) for one in covered for other in each.polygons), each.name
    return found


def blocked(asked: PlanWay) -> Blocked:
    found = plan(asked)
    assert isinstance(found, Blocked), found
    return found


def test_an_empty_floor_is_crossed_straight() -> None:
    found = way_of(PlanWay(START, ToPose((4.0, 3.0), 1.0), LONG))
    assert found.poses == (Pose(4.0, 3.0, 1.0),)
    assert found.length_m == pytest.approx(5.0)


def test_a_way_leads_round_a_crate() -> None:
    found = way_of(PlanWay(START, ToPose((4.0, 0.0)), LONG, (obstacle("crate", box(2, 0, 0.3, 0.3)),)))
    assert 4.0 < found.length_m < 4.8


def test_a_long_base_passes_a_door_in_which_it_could_not_turn() -> None:
    walls = obstacle("wall", box(2, 2.3, 0.1, 2.0), box(2, -2.3, 0.1, 2.0))  # the door is 0.6 m wide
    found = way_of(PlanWay(START, ToPose((4.0, 0.0)), LONG, (walls,)))
    assert found.length_m < 4.2


def test_what_is_around_the_goal_is_named() -> None:
    cage = [obstacle("north", box(4, 1, 1, 0.1)), obstacle("south", box(4, -1, 1, 0.1))]
    cage += [obstacle("west", box(3, 0, 0.1, 1)), obstacle("east", box(5, 0, 0.1, 1))]
    found = blocked(PlanWay(START, ToPose((4.0, 0.0)), LONG, (*cage, obstacle("elsewhere", box(0, 4, 0.3, 0.3)))))
    assert found.place == "goal" and set(found.by) == {"north", "south", "west", "east"}


def test_the_walls_of_a_room_without_a_door_are_named_and_nothing_of_the_floor_around() -> None:
    room = [obstacle("north", box(6, 2, 2, 0.1)), obstacle("south", box(6, -2, 2, 0.1))]
    room += [obstacle("west", box(4, 0, 0.1, 2)), obstacle("east", box(8, 0, 0.1, 2))]
    others = [obstacle(f"crate {number}", box(-1.5, number - 3, 0.2, 0.2)) for number in range(7)]
    for start, goal in ((START, (6.0, 0.0)), (Pose(6.0, 0.0, 0.0), START[:2])):
        found = blocked(PlanWay(start, ToPose(goal), LONG, (*room, *others)))
        assert found.place == "between" and set(found.by) == {"north", "south", "west", "east"}


def test_a_goal_in_a_thing_names_the_thing() -> None:
    found = blocked(PlanWay(START, ToPose((2.0, 0.0)), LONG, (obstacle("crate", box(2, 0, 0.3, 0.3)),)))
    assert found == Blocked("goal", ("crate",))


def test_a_goal_at_which_the_base_does_not_fit_as_it_is_to_look_is_blocked() -> None:
    wall = obstacle("wall", box(2, 0.9, 3, 0.5))
    assert way_of(PlanWay(START, ToPose((2.0, 0.0), 0.0), LONG, (wall,)))
    assert blocked(PlanWay(START, ToPose((2.0, 0.0), math.pi / 2), LONG, (wall,))).by == ("wall",)


def test_a_base_that_stands_close_to_a_wall_can_leave_it() -> None:
    """It drives on straight before it turns."""
    wall = obstacle("wall", box(0, 0.24, 0.6, 0.02))  # 2 cm beside it
    assert way_of(PlanWay(START, ToPose((3.0, -2.0)), LONG, (wall,)))


def test_a_base_that_is_shut_in_cannot_leave() -> None:
    cage = obstacle("cage", box(0, 0.6, 1, 0.1), box(0, -0.6, 1, 0.1), box(0.9, 0, 0.1, 0.6), box(-0.9, 0, 0.1, 0.6))
    assert blocked(PlanWay(START, ToPose((3.0, 0.0)), LONG, (cage,))) == Blocked("start", ("cage",))


def test_occupied_cells_of_the_map_are_obstacles() -> None:
    cells = FloorCells(np.array(((15, 0, 1, 40),), dtype="<u2").tobytes(), 0.1, (0.0, -2.0, 0.0))  # a wall at x 1.5 m
    found = way_of(PlanWay(START, ToPose((3.0, 0.0)), LONG, (), cells))
    assert found.length_m > 4.5
    shut = (Strip((0.0, 0.0), (3.0, 0.0), 1.5),)
    assert set(blocked(PlanWay(START, ToPose((3.0, 0.0)), LONG, (), cells, shut)).by) <= {MAP, EDGE}


def test_a_way_stays_in_its_corridor() -> None:
    strips = (Strip((0.0, 0.0), (0.0, 4.0), 1.4), Strip((0.0, 4.0), (4.0, 4.0), 1.4))
    found = way_of(PlanWay(START, ToPose((4.0, 4.0)), LONG, (), None, strips))
    assert found.length_m > 7.5


def test_near_a_thing_the_base_looks_at_it() -> None:
    crate = obstacle("crate", box(3, 1, 0.3, 0.3))
    (*_, last) = way_of(PlanWay(START, Near("crate", (3.0, 1.0)), LONG, (crate,))).poses
    assert math.dist(last[:2], (3.0, 1.0)) < 1.4
    assert last.heading == pytest.approx(math.atan2(1.0 - last.y, 3.0 - last.x))


def test_aside_is_the_nearest_place_off_the_floor_that_is_kept_free() -> None:
    found = way_of(PlanWay(START, AsideOf((box(0, 0, 3.0, 0.4),)), LONG))
    assert abs(found.poses[-1].y) == pytest.approx(0.4 + math.hypot(0.5, 0.2) + 0.08, abs=0.1)
    assert way_of(PlanWay(Pose(0.0, 3.0, 0.0), AsideOf((box(0, 0, 3.0, 0.4),)), LONG)).poses == ()


def test_a_base_that_drives_sideways_goes_on_from_its_heading() -> None:
    walls = obstacle("wall", box(2, 2.3, 0.1, 2.0), box(2, -2.3, 0.1, 2.0))
    assert way_of(PlanWay(START, ToPose((4.0, 0.0)), LONG, (walls,), lateral=True))


def test_a_base_that_drives_sideways_fits_on_each_leg_of_its_way() -> None:
    """The straight way to the goal is none: it leads through the wall beside the door."""
    walls = obstacle("wall", box(2, 31.6, 0.1, 30), box(2, -29.4, 0.1, 30))  # the door is 1 m wide, at y 1.1 m
    assert len(way_of(PlanWay(START, ToPose((4.0, 0.0)), LONG, (walls,), lateral=True)).poses) > 2


def test_what_is_too_far_is_said() -> None:
    assert plan(PlanWay(START, ToPose((500.0, 0.0)), LONG)) == TooFar(200.0)


@pytest.mark.parametrize("seed", range(12))
def test_random_scenes_are_crossed_or_blocked(seed: int) -> None:
    """What a way covers meets nothing, as ``way_of`` asserts."""
    chance = random.Random(seed)
    places = [(chance.uniform(0, 12), chance.uniform(0, 12)) for _ in range(25)]
    scene = [obstacle(f"o{number}", box(*at, *_half(chance))) for number, at in enumerate(places)]
    start = Pose(chance.uniform(0, 12), chance.uniform(0, 12), chance.uniform(-3, 3))
    asked = PlanWay(start, ToPose((chance.uniform(0, 12), chance.uniform(0, 12))), LONG, tuple(scene))
    if _is_free(start, scene) and isinstance(plan(asked), Way):
        way_of(asked)


def _half(chance: random.Random) -> tuple[float, float]:
    return chance.uniform(0.1, 0.6), chance.uniform(0.1, 0.6)


def _is_free(pose: Pose, scene: Sequence[Obstacle]) -> bool:
    here = box(pose.x, pose.y, 0.7, 0.7)
    return not any(meets(here, each.polygons[0]) for each in scene)
