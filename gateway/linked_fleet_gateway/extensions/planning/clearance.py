"""Contacts of a robot in one configuration, by the margins of the collision check. Metre."""

from collections.abc import Iterable, Iterator

import numpy as np

from linked_fleet_gateway.extensions.world.collision_check import CLEARANCE_M, SLACK_M
from linked_fleet_gateway.extensions.world.held_bodies import Permission
from linked_fleet_gateway.extensions.world.messages import Check, CollisionFound, Positions
from linked_fleet_gateway.extensions.world.path import moved_positions
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surroundings import (
    MARGIN_M,
    TOUCHING_M,
    MovingRobot,
    StaticBody,
    distance,
    free_distance,
    meeting_point,
    se3,
)


def touched(
    asked: Check, robot: Robot, things: list[StaticBody], start: Positions, goal: Positions
) -> CollisionFound | None:
    """Return what the robot would touch at the goal; None if nothing. What is as near at the start may be."""
    there, here = MovingRobot(robot, start), MovingRobot(robot, start)
    there.set_positions(moved_positions(robot, start, goal))  # type: ignore[arg-type]  # of numbers, numbers
    permission = Permission.of(asked, robot)
    for body, thing in _near_things(robot, there, things):
        if permission.allows(body, thing):
            continue
        apart = free_distance(there.shape(body), thing.shape, MARGIN_M)
        if apart < MARGIN_M and apart < free_distance(here.shape(body), thing.shape, MARGIN_M) - SLACK_M:
            return _meeting(asked, there, body, thing, 1.0)
    for one, other in robot.pairs:
        if robot.anchored[one] and there.gap(one, other) < CLEARANCE_M:
            apart = distance(there.shape(one), there.shape(other), CLEARANCE_M)
            if apart < CLEARANCE_M and distance(here.shape(one), here.shape(other), CLEARANCE_M) > max(
                apart, TOUCHING_M
            ):
                mine, its = robot.bodies[one], robot.bodies[other]
                return CollisionFound(mine.link, "self", "", its.link, 1.0, None, mine.held, its.held)
    return None


def hindered(
    asked: Check, robot: Robot, things: list[StaticBody], start: Positions, joints: Iterable[str]
) -> CollisionFound | None:
    """Return what is nearest to parts that ``joints`` move, within the margin of the check at the start, if any is."""
    here, permission = MovingRobot(robot, start), Permission.of(asked, robot)
    moved = np.any(robot.reach_m[[robot.model.getJointId(name) for name in joints]] > 0.0, axis=0).tolist()
    least_m, nearest = MARGIN_M, None
    for body, thing in _near_things(robot, here, things):
        if permission.allows(body, thing) or not moved[body]:
            continue
        apart = free_distance(here.shape(body), thing.shape, MARGIN_M)
        if apart < least_m:
            least_m, nearest = apart, (body, thing)
    return None if nearest is None else _meeting(asked, here, *nearest, 0.0)


def _meeting(asked: Check, robot: MovingRobot, body: int, thing: StaticBody, share: float) -> CollisionFound:
    point = meeting_point(robot.shape(body), thing.shape)
    place = None if point is None else tuple(np.round(se3(asked.robot.base).act(point), 4).tolist())
    mine = robot.robot.bodies[body]
    return CollisionFound(mine.link, thing.kind, thing.name, thing.link, share, place, mine.held, thing.held)


def _near_things(robot: Robot, there: MovingRobot, things: list[StaticBody]) -> Iterator[tuple[int, StaticBody]]:
    for i in range(len(robot.bodies)):
        if not robot.anchored[i]:
            continue
        yield from ((i, thing) for thing in things if there.gap_to(i, thing) < MARGIN_M)
