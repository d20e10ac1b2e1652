"""The speed at which agents let joints move, which planners of their motions know too. rad/s or m/s.

A joint cruises at CRUISE_SHARE of its URDF velocity limit at most, so that the real joint with its lag and ripple stays
below the limit. The cruise speed is also capped at a value for machines among people. It takes RAMP_S to reach it: a
URDF states no acceleration.
"""

from linked_fleet_agent.urdf.facts import JointFacts

CRUISE_SHARE = 0.8
SPEED_SHARE = 0.9  # share of the speed that a command allows, because real joints ripple about their setpoint
MAX_CRUISE_RAD_S, MAX_CRUISE_M_S = 1.5, 0.25
# For joints whose URDF states no velocity limit.
UNKNOWN_CRUISE_RAD_S, UNKNOWN_CRUISE_M_S = 0.5, 0.05
RAMP_S = 0.4


def cruise_of(joint: JointFacts) -> float:
    """Return the highest setpoint speed of ``joint``, in rad/s or m/s."""
    limit = joint.limits.velocity
    if limit is None:
        return UNKNOWN_CRUISE_M_S if joint.linear else UNKNOWN_CRUISE_RAD_S
    return min(CRUISE_SHARE * limit, MAX_CRUISE_M_S if joint.linear else MAX_CRUISE_RAD_S)
