"""Links that the check does not cover, and what they may meet. Metre.

The size of such a link is unknown. It is taken to reach ``UNKNOWN_M`` from its origin, or twice as far as the joints
that it carries.
"""

import math
from collections.abc import Iterable, Mapping

import coal
import numpy as np

from linked_fleet_gateway.extensions.world.messages import Check, Placement, UncheckedNear
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surroundings import MARGIN_M, object_bodies, se3
from linked_fleet_gateway.fleet.model import Joint, JointKind, RobotModel

UNKNOWN_M = 1.0


def bound_m(tree: RobotModel, links: Iterable[str]) -> float:
    """Return a bound of the distance of links of unknown size from the root; infinite if they may be anywhere."""
    return max((_origin_bound_m(tree, link) + _size_m(tree, link) for link in links), default=0.0)


def _origin_bound_m(tree: RobotModel, link: str) -> float:
    far, above = 0.0, tree.links[link].parent_joint
    while above is not None:
        joint = tree.joints[above]
        far += _step_m(joint)
        above = tree.links[joint.parent].parent_joint
    return far


def _step_m(joint: Joint) -> float:
    """Return a bound of the distance between the origins of both links of a joint."""
    if joint.kind in (JointKind.FLOATING, JointKind.PLANAR):
        return math.inf
    apart = math.hypot(*joint.origin.position_m)
    if joint.kind is not JointKind.PRISMATIC:
        return apart
    lower, upper = joint.limits.lower, joint.limits.upper
    return math.inf if lower is None or upper is None else apart + max(abs(lower), abs(upper))


def _size_m(tree: RobotModel, link: str) -> float:
    carried = (math.hypot(*tree.joints[each].origin.position_m) for each in tree.links[link].child_joints)
    return max(UNKNOWN_M, 2 * max(carried, default=0.0))


def unchecked_near(
    asked: Check, robots: Mapping[str, Robot], objects: Mapping[str, coal.CollisionGeometry]
) -> UncheckedNear | None:
    """Return unchecked links that may meet something, and which no placement accepts; None if there are none."""
    if robots[asked.robot.key].unchecked and not asked.robot.accepts_unchecked:
        met = _meets_own(asked, robots, objects)
        if met is not None:
            return met
    others = (each for each in asked.robots if not each.accepts_unchecked and has_unchecked_near(asked, each, robots))
    other = next(others, None)
    return None if other is None else UncheckedNear(False, "robot", other.name)


def _meets_own(
    asked: Check, robots: Mapping[str, Robot], objects: Mapping[str, coal.CollisionGeometry]
) -> UncheckedNear | None:
    reach_m = robots[asked.robot.key].unchecked_m + MARGIN_M
    for thing in object_bodies(asked, objects):
        if float(np.linalg.norm(thing.centre)) <= reach_m + thing.radius:
            return UncheckedNear(True, "object", thing.name)
    for each in asked.robots:
        if _apart_m(asked, each) <= reach_m + _whole_m(robots[each.key]):
            return UncheckedNear(True, "robot", each.name)
    return None


def has_unchecked_near(asked: Check, other: Placement, robots: Mapping[str, Robot]) -> bool:
    """Return True if the moving robot may meet unchecked links of another robot."""
    robot = robots[other.key]
    reach_m = robot.unchecked_m + MARGIN_M + _whole_m(robots[asked.robot.key])
    return bool(robot.unchecked) and _apart_m(asked, other) <= reach_m


def _whole_m(robot: Robot) -> float:
    return max(robot.radius_m, robot.unchecked_m)


def _apart_m(asked: Check, other: Placement) -> float:
    return float(np.linalg.norm((se3(asked.robot.base).inverse() * se3(other.base)).translation))
