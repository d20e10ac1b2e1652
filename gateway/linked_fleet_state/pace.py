"""The speed at which the agents of robots move joints, from rest to rest. Pure. Radian, metre, second."""

import math
from collections.abc import Mapping

from linked_fleet_agent.urdf.cruise import RAMP_S, SPEED_SHARE, cruise_of
from linked_fleet_agent.urdf.facts import JointFacts
from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_state.model import JointKind
from linked_fleet_state.robot import Robot


def speed_of(robot: Robot, name: str, scale: float, most: float = math.inf) -> float:
    """Return the speed that the agent lets a joint reach at a share of it, if ``most`` was asked for."""
    assert robot.model is not None
    joint = robot.model.joints[name]
    linear = joint.kind is JointKind.PRISMATIC
    return min(cruise_of(JointFacts(name, linear, joint.limits)), SPEED_SHARE * most) * scale


def duration_s(robot: Robot, motion: Move | Follow, scale: float, start: Mapping[str, float]) -> float:
    """Return how long a motion from rest takes: until the slowest joint has arrived, or the last waypoint."""
    if isinstance(motion, Follow):
        return motion.times_s[-1]
    found = 0.0
    for name, end in motion.targets.items():
        way, speed = abs(end - start[name]), speed_of(robot, name, scale, motion.speeds.get(name, math.inf))
        ramps = 2.0 * math.sqrt(way * RAMP_S / speed)
        found = max(found, way / speed + RAMP_S if way >= speed * RAMP_S else ramps)
    return found
