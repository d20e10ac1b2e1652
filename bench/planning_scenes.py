"""Scenes in which a path of an arm is planned, the same for each seed. Metre, radian.

A scene has the forms of objects of the world around the arm. Its start and its goal are free by the margins of the
collision check, its direct path is not. In half of the scenes the goal is in a narrow place: between two plates, below
the top of a table, or in a shelf.
"""

import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import coal
import numpy as np
import pinocchio as pin
from msgspec.structs import replace

from bench.collisions import robot_of
from bench.planning_forms import Array, pose, shelf, table, turned_to
from bench.rigid import Rigid
from linked_fleet_agent.robots.catalogue import MODELS, data_folder
from linked_fleet_agent.urdf.cruise import RAMP_S, cruise_of
from linked_fleet_agent.urdf.facts import JointFacts
from linked_fleet_gateway.extensions.planning.messages import FindPath, JointBounds
from linked_fleet_gateway.extensions.world.collision_check import CLEARANCE_M, check
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CollisionFound,
    MotionPath,
    PathSegment,
    Placement,
    Positions,
)
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, Geometry, Sphere
from linked_fleet_gateway.extensions.world.shapes import build_object_shape
from linked_fleet_gateway.extensions.world.surroundings import (
    MARGIN_M,
    MovingRobot,
    StaticBody,
    distance,
    object_bodies,
)
from linked_fleet_state.model import JointKind, Pose

KINDS = ("open", "plates", "open", "table", "open", "shelf")
"""Kinds of scenes, in turn by their seed."""
_CHECK_S = 20.0  # speed of the check is not measured here
_MOST_ATTEMPTS = 500
_TURN_RAD = 3.1
_AT_ROOT = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Form:
    geometry: Geometry
    pose: Pose


class Arm:
    """An arm of a robot of example-robot-data, prepared for the check and for the independent one."""

    def __init__(self, name: str, file: str, joints: Sequence[str], home: Mapping[str, float]) -> None:
        path = data_folder() / file
        self.name, self.file, self.joints = name, path, tuple(joints)
        self.rigid = Rigid(path)
        self.robot: Robot = robot_of(path.read_text(), self.rigid, path)
        names = [each for each in self.robot.model.names if each != "universe"]
        self.home: Positions = self.rigid.complete({each: home.get(each, 0.0) for each in names})
        self._standing = MovingRobot(self.robot, self.home)
        self._ids = [self.robot.model.getJointId(each) for each in self.joints]
        reach = self.robot.reach_m[self._ids]
        self.moved: list[int] = np.nonzero((reach > 0).any(axis=0) & self.robot.anchored)[0].tolist()
        self.pairs = self._apart_at_home()

    def _apart_at_home(self) -> list[tuple[int, int]]:
        """Return the pairs of the check that the arm moves relative to each other, and that are apart at home."""
        moves = self.robot.reach_m[self._ids] > 0
        pairs = [(i, k) for i, k in self.robot.pairs if (moves[:, i] != moves[:, k]).any()]
        return [(i, k) for i, k in pairs if self._gap(i, k) >= CLEARANCE_M]

    def bounds(self, name: str, start: float, goal: float) -> JointBounds:
        """Return what a joint may do, as the planner of the gateway says."""
        joint = self.robot.tree.joints[name]
        speed = cruise_of(JointFacts(name, joint.kind is JointKind.PRISMATIC, joint.limits))
        low, high = joint.limits.lower, joint.limits.upper
        if joint.kind is JointKind.CONTINUOUS or low is None or high is None:
            low, high = min(start, goal) - math.pi, max(start, goal) + math.pi
        return JointBounds(min(low, start, goal), max(high, start, goal), speed, speed / RAMP_S)

    def somewhere(self, chance: np.random.Generator) -> Positions:
        """Return positions of the arm at which it does not touch the robot."""
        while True:
            found = {name: float(chance.uniform(*self._range(name))) for name in self.joints}
            self._standing.set_positions(found)
            if all(self._gap(i, k) >= CLEARANCE_M for i, k in self.pairs):
                return found

    def is_free(self, positions: Positions, things: Sequence[StaticBody]) -> bool:
        self._standing.set_positions(positions)
        for body in self.moved:
            shape = self._standing.shape(body)
            if any(distance(shape, thing.shape, MARGIN_M) < MARGIN_M for thing in things):
                return False
        return True

    def tool(self, positions: Positions) -> tuple[Array, Array]:
        """Return the place of what the last joint carries, and the direction from the forearm to it."""
        self._standing.set_positions(positions)
        last = [i for i in self.moved if self.robot.reach_m[self._ids[-1], i] > 0]
        forearm = [i for i in self.moved if self.robot.bodies[i].joint in self._ids[len(self._ids) // 2 : -1]]
        tool, before = (np.mean([self._centre(i) for i in each], axis=0) for each in (last, forearm))
        return tool, (tool - before) / np.linalg.norm(tool - before)

    def _centre(self, body: int) -> Array:
        found: Array = self._standing.at(body).act(self.robot.bodies[body].centre)
        return found

    def _range(self, name: str) -> tuple[float, float]:
        limits = self.robot.tree.joints[name].limits
        lower = -_TURN_RAD if limits.lower is None else max(limits.lower, -_TURN_RAD)
        return lower, _TURN_RAD if limits.upper is None else min(limits.upper, _TURN_RAD)

    def _gap(self, i: int, k: int) -> float:
        return distance(self._standing.shape(i), self._standing.shape(k), CLEARANCE_M)


@dataclass(frozen=True)
class Scene:
    """An arm among objects, with a start and a goal."""

    arm: Arm
    seed: int
    kind: str
    forms: tuple[Form, ...]
    start: Positions
    goal: Positions

    @cached_property
    def objects(self) -> dict[str, coal.CollisionGeometry]:
        return {f"o{n}": build_object_shape(form.geometry) for n, form in enumerate(self.forms)}

    @property
    def robots(self) -> dict[str, Robot]:
        return {self.arm.name: self.arm.robot}

    def question(self, seed: int, within_s: float) -> FindPath:
        bounds = {name: self.arm.bounds(name, self.start[name], self.goal[name]) for name in self.arm.joints}
        return FindPath(self.around((PathSegment(self.goal),)), bounds, (self.goal,), within_s, seed)

    def around(self, legs: tuple[PathSegment, ...]) -> Check:
        places = tuple(Placement(f"o{n}", f"o{n}", form.pose) for n, form in enumerate(self.forms))
        path = MotionPath(self.arm.home | self.start, legs)
        return Check(Placement(self.arm.name, self.arm.name, _AT_ROOT), (path,), (), places, _CHECK_S)

    def checked(self, legs: tuple[PathSegment, ...], closest_within_s: float = 0.0) -> Answer:
        around = replace(self.around(legs), closest_within_s=closest_within_s)
        return check(around, self.robots, self.objects)

    def digest(self) -> int:
        """Return a number by which a changed scene is noticed."""
        numbers = [*self.start.values(), *self.goal.values(), *(x for form in self.forms for x in form.pose.position_m)]
        return zlib.crc32(" ".join(f"{each:.4f}" for each in numbers).encode())


@lru_cache
def arm(name: str) -> Arm:
    """Return one of ``ARMS``; it is prepared once."""
    file, joints, home = ARMS[name]
    return Arm(name, file, joints, home)


def scene(name: str, seed: int) -> Scene:
    """Return the scene of an arm with a seed."""
    chance, it, kind = np.random.default_rng([seed, list(ARMS).index(name)]), arm(name), KINDS[seed % len(KINDS)]
    for _ in range(_MOST_ATTEMPTS):
        start, goal = it.somewhere(chance), it.somewhere(chance)
        forms = _free(it, list(_narrow(kind, it, goal, chance)), start, goal)
        if forms is None:
            continue
        for form in _scattered(it, start, goal, chance):
            forms = _free(it, [*forms, form], start, goal) or forms
        found = Scene(it, seed, kind, tuple(forms), start, goal)
        if isinstance(found.checked((PathSegment(goal),)), CollisionFound):
            return found
    raise AssertionError(f"no scene of {name} with seed {seed}")


def _free(it: Arm, forms: list[Form], start: Positions, goal: Positions) -> list[Form] | None:
    """Return the forms, or None if the last one or two of them are in the way of the start or the goal."""
    made = Scene(it, 0, "", tuple(forms[-2:]), start, goal)
    things = list(object_bodies(made.around(()), made.objects))
    return forms if it.is_free(start, things) and it.is_free(goal, things) else None


def _narrow(kind: str, it: Arm, goal: Positions, chance: np.random.Generator) -> Iterator[Form]:
    """Yield what makes the goal hard to reach."""
    at, ahead = it.tool(goal)
    if kind == "plates":
        gap, side = chance.uniform(0.18, 0.4), chance.uniform(0.4, 0.7)
        across = np.cross(ahead, chance.normal(size=3))
        across /= np.linalg.norm(across)
        for sign in (-1, 1):
            centre = at + 0.2 * side * ahead + sign * (gap / 2 + 0.01) * across
            yield Form(Box((side, side, 0.02)), pose(centre, turned_to(ahead, across)))
    elif kind == "table":
        length, width = chance.uniform(0.6, 1.0, 2).tolist()
        top = at + np.array((0.2 * ahead[0], 0.2 * ahead[1], chance.uniform(0.12, 0.25)))
        yield Form(table(length, width, 0.6), pose(top, pin.utils.rotate("z", chance.uniform(-math.pi, math.pi))))
    elif kind == "shelf":
        size = chance.uniform((0.3, 0.35, 0.25), (0.5, 0.6, 0.45))
        yaw = math.atan2(ahead[1], ahead[0])
        yield Form(
            shelf(*size), pose(at + 0.1 * np.array((math.cos(yaw), math.sin(yaw), 0)), pin.utils.rotate("z", yaw))
        )


def _scattered(it: Arm, start: Positions, goal: Positions, chance: np.random.Generator) -> Iterator[Form]:
    """Yield objects, every second one near the direct path of the tool."""
    for n in range(int(chance.integers(3, 11))):
        if n % 2 == 0:
            share = chance.uniform(0.1, 0.9)
            at, _ = it.tool({name: (1 - share) * start[name] + share * goal[name] for name in it.joints})
            at = at + chance.normal(scale=0.05, size=3)
        else:
            at = chance.uniform(-1.0, 1.0, 3) + np.array((0.0, 0.0, 0.7))
        turn = pin.Quaternion(*(chance.normal(size=4))).normalized().toRotationMatrix()
        yield Form(_form(n, chance), pose(at, turn))


def _form(n: int, chance: np.random.Generator) -> Geometry:
    if n % 3 == 0:
        x, y, z = chance.uniform(0.08, 0.4, 3).tolist()
        return Box((x, y, z))
    if n % 3 == 1:
        return Sphere(float(chance.uniform(0.05, 0.18)))
    return Cylinder(float(chance.uniform(0.03, 0.1)), float(chance.uniform(0.3, 1.0)))


def _numbered(prefix: str, count: int) -> tuple[str, ...]:
    return tuple(f"{prefix}{n}{'_joint' if 'arm' in prefix else ''}" for n in range(1, count + 1))


ARMS: Mapping[str, tuple[str, Sequence[str], Mapping[str, float]]] = {
    "panda": (MODELS["panda"].file, _numbered("panda_joint", 7), MODELS["panda"].home),
    "ur5": (
        MODELS["ur5"].file,
        tuple(f"{each}_joint" for each in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")),
        MODELS["ur5"].home,
    ),
    "baxter": (
        MODELS["baxter"].file,
        tuple(f"right_{each}" for each in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")),
        MODELS["baxter"].home,
    ),
    "tiago": (MODELS["tiago"].file, ("torso_lift_joint", *_numbered("arm_", 7)), MODELS["tiago"].home),
    "kinova": (
        "kinova_description/robots/kinova.urdf",
        _numbered("j2s6s200_joint_", 6),
        {"j2s6s200_joint_2": math.pi, "j2s6s200_joint_3": math.pi},
    ),
}
"""By name: file, joints of the arm, and the positions of all joints at home (others 0)."""
