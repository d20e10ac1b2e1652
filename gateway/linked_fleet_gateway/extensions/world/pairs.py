"""Which parts of a robot are held against each other. Found once, when the robot is prepared.

Left out are parts that no joint or one joint moves against each other; two joints whose origins are less than 2 cm
apart count as one. The two sides of a gripper, of which one mimics the other, are made to touch. Parts with two or
three joints between them that touch in more than a third of the positions of these joints are drawn so, and say nothing
of a collision.
"""

from itertools import combinations

import coal
import numpy as np
import pinocchio as pin

from linked_fleet_gateway.extensions.world.robot import Robot, put
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.fleet.model import JointKind

_TRIALS = 64
_MOST_DOUBTFUL = 2_000  # pairs that take a second to try; of a robot with more, all are held against each other
_MOST_TOUCHING = 1 / 3  # share of the positions
_MOST_BETWEEN = 3
_COMPOUND_M = 0.02
_TURN_RAD = np.pi


def own_pairs(robot: Robot) -> list[tuple[int, int]]:
    """Indices into the robot's bodies."""
    supports = [set(robot.model.supports[joint]) for joint in range(robot.model.njoints)]
    found: list[tuple[int, int]] = []
    doubtful: dict[tuple[int, ...], list[tuple[int, int]]] = {}
    for (i, one), (j, other) in combinations(enumerate(robot.bodies), 2):
        between = tuple(sorted(supports[one.joint] ^ supports[other.joint]))
        if len(between) > _MOST_BETWEEN:
            found.append((i, j))
        elif len(between) == _MOST_BETWEEN or (len(between) == 2 and not _is_one_joint(robot, *between)):
            doubtful.setdefault(between, []).append((i, j))
    if sum(map(len, doubtful.values())) > _MOST_DOUBTFUL:
        return found + [pair for pairs in doubtful.values() for pair in pairs]
    for between, pairs in doubtful.items():
        share = _touching(robot, between, pairs)
        found += [pair for pair in pairs if share[pair] <= _MOST_TOUCHING]
    return found


def _is_one_joint(robot: Robot, one: int, other: int) -> bool:
    return _is_gripper(robot, one, other) or _is_compound(robot, one, other)


def _is_gripper(robot: Robot, one: int, other: int) -> bool:
    names = robot.model.names[one], robot.model.names[other]
    mimics = (robot.tree.joints[name].mimic for name in names)
    return any(mimic is not None and mimic.joint in names for mimic in mimics)


def _is_compound(robot: Robot, one: int, other: int) -> bool:
    """Return True if two successive joints turn about points so near that they act as one with two axes."""
    turn = all(robot.tree.joints[robot.model.names[each]].kind is not JointKind.PRISMATIC for each in (one, other))
    apart = float(np.linalg.norm(robot.model.jointPlacements[other].translation))
    return turn and robot.model.parents[other] == one and apart < _COMPOUND_M


def _touching(robot: Robot, between: tuple[int, ...], pairs: list[tuple[int, int]]) -> dict[tuple[int, int], float]:
    """In which share of the positions of the joints ``between`` each pair touches; from the same trials each time."""
    data, placed = robot.model.createData(), pin.GeometryData(robot.geometry)
    counts = dict.fromkeys(pairs, 0)
    for trial in _spread(_TRIALS, len(between)):
        q: Array = pin.neutral(robot.model)
        for joint, share in zip(between, trial, strict=True):
            put(robot, q, joint, _within(robot, joint, float(share)))
        pin.updateGeometryPlacements(robot.model, data, robot.geometry, placed, q)
        for i, j in pairs:
            counts[i, j] += _meet(robot, placed, i, j)
    return {pair: count / _TRIALS for pair, count in counts.items()}


def _spread(count: int, dimensions: int) -> Array:
    """Points that fill the unit cube evenly: the additive recurrence of the generalised golden ratio."""
    ratio = 2.0
    for _ in range(32):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1)
    found: Array = (0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0
    return found


def _within(robot: Robot, joint: int, share: float) -> float:
    limits = robot.tree.joints[robot.model.names[joint]].limits
    lower = -_TURN_RAD if limits.lower is None else max(limits.lower, -_TURN_RAD)
    upper = _TURN_RAD if limits.upper is None else min(limits.upper, _TURN_RAD)
    return lower + share * (upper - lower)


def _meet(robot: Robot, placed: pin.GeometryData, i: int, j: int) -> bool:
    one, other, found = placed.oMg[i], placed.oMg[j], coal.CollisionResult()
    coal.collide(
        robot.bodies[i].shape,
        coal.Transform3s(one.rotation, one.translation),
        robot.bodies[j].shape,
        coal.Transform3s(other.rotation, other.translation),
        coal.CollisionRequest(),
        found,
    )
    return bool(found.isCollision())
