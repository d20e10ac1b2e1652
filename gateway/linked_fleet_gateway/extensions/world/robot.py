"""A robot prepared for collision checks, and the pairs of its bodies to check against each other. Metre.

Pairs are selected once, when the robot is prepared. Excluded are bodies that no joint or a single joint moves relative
to each other; two joints whose origins are less than 2 cm apart count as one. The two sides of a gripper, of which one
mimics the other, are excluded too, as are bodies whose places relative to each other are unknown. So are bodies with
two or three joints between them that touch in more than a third of the sampled positions: their geometry overlaps by
design.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linked_fleet_gateway.extensions.world.corners import corners_of
from linked_fleet_gateway.extensions.world.reach import links_m, reach_m, slide_m
from linked_fleet_gateway.extensions.world.surfaces import Array, Surface
from linked_fleet_state.kinematics import loose_joint
from linked_fleet_state.model import JointKind, RobotModel
from linked_fleet_state.unchecked import UncheckedLink


@dataclass(frozen=True)
class Body:
    """A collision body of a link. ``centre`` is in its own frame; all its points are within ``radius`` of it.

    ``shape`` is exact. ``hull`` is convex and contains it. ``surface`` is the mesh of a non-convex body. One that the
    link holds is the object ``held``.
    """

    link: str
    joint: int
    shape: coal.CollisionGeometry
    hull: coal.CollisionGeometry
    surface: Surface | None
    centre: Array
    radius: float
    held: str = ""

    @cached_property
    def corners(self) -> Array:
        """The corners (N, 3) of the hull in its own frame; of a shape with round ends, the centres of these."""
        return corners_of(self.hull)


@dataclass(frozen=True)
class Robot:
    """A prepared robot; ``geometry`` has one shape for each of ``bodies``, in order."""

    tree: RobotModel
    model: pin.Model
    geometry: pin.GeometryModel
    bodies: tuple[Body, ...]
    reach_m: Array
    """By joint and body: bound of the distance of the body from the origin of the joint.

    0 if the joint does not move the body. Row 0 is that of the root. Infinite if the distance is unknown: behind a
    floating or planar joint, or a prismatic one without limits.
    """

    pairs: tuple[tuple[int, int], ...] = ()
    """Pairs of bodies to check against each other."""
    unchecked: tuple[UncheckedLink, ...] = ()
    """The links that are not covered by the bodies."""
    unchecked_m: float = 0.0
    """Bound of the distance of these links from the root."""

    @cached_property
    def radius_m(self) -> float:
        """Bound of the distance of the robot from its root, without bodies that may be anywhere."""
        return float(self.reach_m[0, self.anchored].max(initial=0.0))

    @property
    def whole_m(self) -> float:
        """Bound of the distance of all links from the root, including unchecked ones."""
        return max(self.radius_m, self.unchecked_m)

    @cached_property
    def islands(self) -> tuple[str, ...]:
        """The floating or planar joint that carries each body, empty for none.

        The positions of these joints are unknown, so only bodies of one island have known places relative to each
        other.
        """
        above = (loose_joint(self.tree, each.link) for each in self.bodies)
        return tuple("" if each is None else each.name for each in above)

    @cached_property
    def anchored(self) -> npt.NDArray[np.bool_]:
        """True for each body whose place relative to the root follows from the positions of joints."""
        return np.array([each == "" for each in self.islands], dtype=bool)

    @cached_property
    def slides_m(self) -> dict[str, float]:
        """By prismatic joint, a bound of how far it shifts what it carries."""
        joints = self.tree.joints.values()
        return {each.name: slide_m(each) for each in joints if each.kind is JointKind.PRISMATIC}

    def reach_by_joint(self, joints: Sequence[str]) -> Array:
        """Return by joint and body how far the body can move at most per motion of the joint."""
        ids = [self.model.getJointId(name) for name in joints]
        slides = np.array([self.tree.joints[name].kind == "prismatic" for name in joints], dtype=bool)
        reach = self.reach_m[ids].reshape(len(ids), len(self.bodies))
        found: Array = np.where(slides[:, None], (reach > 0).astype(float), reach)
        return found

    def reaching(self, configurations: Iterable[Mapping[str, float]]) -> "Robot":
        """Return the robot with its reach in these positions, in which prismatic joints may exceed their limits."""
        slides, extents = self.slides_m, dict[str, float]()
        for positions in configurations:
            for name in slides.keys() & positions.keys():
                extents[name] = max(abs(positions[name]), extents.get(name, 0.0))
        if all(extents.get(name, 0.0) <= bound < math.inf for name, bound in slides.items()):
            return self
        joints, sizes_m = [each.joint for each in self.bodies], _sizes_m(self.geometry, self.bodies)
        reach = reach_m(self.tree, self.model, joints, sizes_m, extents)
        return replace(self, reach_m=reach, unchecked_m=links_m(self.tree, (e.link for e in self.unchecked), extents))


def build_reach(tree: RobotModel, model: pin.Model, geometry: pin.GeometryModel, bodies: Sequence[Body]) -> Array:
    """Return ``Robot.reach_m`` for positions within limits."""
    return reach_m(tree, model, [each.joint for each in bodies], _sizes_m(geometry, bodies))


def _sizes_m(geometry: pin.GeometryModel, bodies: Sequence[Body]) -> list[float]:
    """Return bounds of the distances of bodies from the origins of their joints."""
    placed = zip(bodies, geometry.geometryObjects, strict=True)
    return [float(np.linalg.norm(at.placement.act(body.centre))) + body.radius for body, at in placed]


def put(robot: Robot, q: Array, joint: int, position: float) -> None:
    """Set the position of a joint of the model in a configuration."""
    kind = robot.model.joints[joint]
    if kind.nq == 1:
        q[kind.idx_q] = position
    elif kind.nq == 2:
        q[kind.idx_q : kind.idx_q + 2] = np.cos(position), np.sin(position)


_TRIALS = 64
_MOST_DOUBTFUL = 2_000  # pairs to sample, which takes a second; a robot with more has all of them checked
_MOST_TOUCHING = 1 / 3  # share of the positions
_MOST_BETWEEN = 3
_COMPOUND_M = 0.02
_TURN_RAD = np.pi


def self_collision_pairs(robot: Robot) -> list[tuple[int, int]]:
    """Return pairs of indices into the robot's bodies."""
    supports = [set(robot.model.supports[joint]) for joint in range(robot.model.njoints)]
    found: list[tuple[int, int]] = []
    doubtful: dict[tuple[int, ...], list[tuple[int, int]]] = {}
    for (i, one), (j, other) in combinations(enumerate(robot.bodies), 2):
        if robot.islands[i] != robot.islands[j]:
            continue
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
    """Return True if two successive joints rotate about almost the same point, like one joint with two axes."""
    turn = all(robot.tree.joints[robot.model.names[each]].kind is not JointKind.PRISMATIC for each in (one, other))
    apart = float(np.linalg.norm(robot.model.jointPlacements[other].translation))
    return turn and robot.model.parents[other] == one and apart < _COMPOUND_M


def _touching(robot: Robot, between: tuple[int, ...], pairs: list[tuple[int, int]]) -> dict[tuple[int, int], float]:
    """Return the share of sampled positions of the joints ``between`` in which each pair touches. Deterministic."""
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
    """Return points that fill the unit cube evenly: the additive recurrence of the generalised golden ratio."""
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
