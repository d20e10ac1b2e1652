"""Paths that are made quicker between the same ends."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from roboplan.core import JointPath, hasCollisionsAlongPath

from linked_fleet_gateway.extensions.planning.finder import STEP
from linked_fleet_gateway.extensions.planning.planner_scene import PlannerScene, SceneWriter
from linked_fleet_gateway.extensions.planning.refining import refined
from linked_fleet_gateway.extensions.planning.tests.arms import (
    ARM,
    BOUNDS,
    CORNER,
    JOINTS,
    SPEED,
    STRETCHED,
    Room,
    wall,
)
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import object_bodies

POST = Room(post=wall(1.0, 0.6))
SPEEDS = np.full(len(JOINTS), SPEED)
WITHIN_S = 0.2


def scene(room: Room, folder: Path) -> PlannerScene:
    goal = {**STRETCHED, "shoulder": CORNER}
    things = list(object_bodies(room.around(STRETCHED, goal), room.shapes))
    return SceneWriter(ARM, STRETCHED, BOUNDS, folder).build(things, (goal,))


def path(made: PlannerScene, *rows: tuple[float, float, float]) -> JointPath:
    found = JointPath()
    order = [JOINTS.index(name) for name in made.joints]
    found.joint_names = made.scene.getJointNames()
    found.positions = [np.array(row)[order] for row in rows]
    return found


def is_free(made: PlannerScene, way: JointPath) -> bool:
    return not any(hasCollisionsAlongPath(made.scene, one, other, STEP) for one, other in pairwise(way.positions))


def time_s(rows: list[Array]) -> float:
    return sum(float(np.abs(other - one).max()) / SPEED for one, other in pairwise(rows))


def test_a_detour_in_free_space_becomes_a_straight_line(tmp_path: Path) -> None:
    made = scene(Room(), tmp_path)
    found = refined(made.scene, path(made, (0, 0, 0), (0.3, 0.9, -0.5), (1.2, 0, 0)), SPEEDS, STEP, WITHIN_S, 1)
    rows = np.array(found.positions)
    assert rows[0] == pytest.approx(np.zeros(3)) and rows[-1].max() == pytest.approx(1.2)
    assert time_s(list(rows)) == pytest.approx(1.2 / SPEED, rel=0.1)


def test_a_way_round_becomes_quicker_and_stays_free(tmp_path: Path) -> None:
    made = scene(POST, tmp_path)
    way = path(made, (0, 0, 0), (0, -2.2, 0), (CORNER, -2.2, 0), (CORNER, 0, 0))
    assert is_free(made, way)
    found = refined(made.scene, way, SPEEDS, STEP, WITHIN_S, 1)
    assert time_s(found.positions) < 0.9 * time_s(way.positions)
    assert (found.positions[0] == way.positions[0]).all() and (found.positions[-1] == way.positions[-1]).all()
    assert is_free(made, found)


def test_without_time_the_path_stays_as_it_is(tmp_path: Path) -> None:
    made = scene(POST, tmp_path)
    way = path(made, (0, 0, 0), (0, -2.2, 0), (CORNER, -2.2, 0))
    found = refined(made.scene, way, SPEEDS, STEP, -1.0, 1)
    assert time_s(found.positions) == pytest.approx(time_s(way.positions))
