"""Bounds of the distance between parts of a robot and its joints, by the triangle inequality along the chain. Metre.

``extents`` are the largest distances from zero of prismatic joints, whatever their limits. Without an extent, a
prismatic joint is within its stops; without these, and behind a floating or planar joint, a bound is infinite.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pinocchio as pin

from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_state.model import Joint, JointKind, RobotModel

UNKNOWN_M = 1.0
"""Least reach from its origin of a link of unknown size."""
_POINT_M = 1e-9  # above zero, which would mean that the joint does not move the body
Extents = Mapping[str, float]
NO_EXTENTS: Extents = {}


def slide_m(joint: Joint, extents: Extents = NO_EXTENTS) -> float:
    """Return a bound of the distance by which a joint shifts what it carries."""
    if joint.kind in (JointKind.FLOATING, JointKind.PLANAR):
        return math.inf
    if joint.kind is not JointKind.PRISMATIC:
        return 0.0
    lower, upper = joint.stops  # beyond the limits of commands
    if lower is None or upper is None:
        return extents.get(joint.name, math.inf)
    return max(abs(lower), abs(upper), extents.get(joint.name, 0.0))


def reach_m(
    tree: RobotModel, model: pin.Model, joints: Sequence[int], sizes_m: Sequence[float], extents: Extents = NO_EXTENTS
) -> Array:
    """Return by joint and body a bound of the distance of the body from the origin of the joint; 0 if not moved by it.

    ``joints`` are those that carry the bodies, ``sizes_m`` the bounds of the bodies' distances from their origins.
    """
    found = np.zeros((model.njoints, len(joints)))
    steps = [0.0] * model.njoints
    for joint in range(1, model.njoints):
        apart = float(np.linalg.norm(model.jointPlacements[joint].translation))
        steps[joint] = apart + slide_m(tree.joints[model.names[joint].strip()], extents)
    for body, (joint, size) in enumerate(zip(joints, sizes_m, strict=True)):
        far = found[joint, body] = max(size, _POINT_M)
        while joint:
            far += steps[joint]
            joint = model.parents[joint]
            found[joint, body] = far
    return found


def links_m(tree: RobotModel, links: Iterable[str], extents: Extents = NO_EXTENTS) -> float:
    """Return a bound of the distance of links of unknown size from the root; 0 without links."""
    return max((_origin_m(tree, link, extents) + _size_m(tree, link) for link in links), default=0.0)


def _origin_m(tree: RobotModel, link: str, extents: Extents) -> float:
    far, above = 0.0, tree.links[link].parent_joint
    while above is not None:
        joint = tree.joints[above]
        far += math.hypot(*joint.origin.position_m) + slide_m(joint, extents)
        above = tree.links[joint.parent].parent_joint
    return far


def _size_m(tree: RobotModel, link: str) -> float:
    """Return the reach of a link from its origin: at least twice as far as the joints that it carries."""
    carried = (math.hypot(*tree.joints[each].origin.position_m) for each in tree.links[link].child_joints)
    return max(UNKNOWN_M, 2 * max(carried, default=0.0))
