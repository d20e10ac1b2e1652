"""The scene in which paths are searched: the robot and what is around it, as one URDF for roboplan. Metre, radian.

Joints that do not move are fixed. Each shape of the robot is a link of its own, so that exactly the pairs of the
collision check are compared. What is around is larger than it is by ``CLEARANCE_M``, unless the robot is nearer than
that at the start or at a goal. A mesh of the robot is replaced by its convex hull, which takes a fraction of the time
to compare, unless the hull is near something at the start or at a goal. So a path may be missed inside a hull, but none
is free that touches the mesh.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from roboplan.core import Scene, loadJointLimitsConfig, loadUrdfSceneDescriptionFromXml

from linked_fleet_gateway.extensions.planning.enlarging import (
    CLEARANCE_M,
    CORNER_M,
    CORNERS,
    OWN_M,
    PARTS_M,
    larger_part,
    most_larger,
    triangles_of,
)
from linked_fleet_gateway.extensions.planning.inflation import Triangles, inflated
from linked_fleet_gateway.extensions.planning.messages import JointBounds
from linked_fleet_gateway.extensions.planning.stl import stl_of, stl_of_hull
from linked_fleet_gateway.extensions.world.held_bodies import NO_PERMISSION, Permission
from linked_fleet_gateway.extensions.world.messages import Positions
from linked_fleet_gateway.extensions.world.path import moved_positions
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import (
    TOUCHING_M,
    MovingRobot,
    Shape,
    StaticBody,
    distance,
)
from linked_fleet_state.model import JointKind


@dataclass(frozen=True)
class PlannerScene:
    """A scene of roboplan, and its names: of joint n ``j{n}``, of the robot's shapes ``b{n}``."""

    scene: Scene
    joints: tuple[str, ...]


class SceneWriter:
    """Writes the URDF of a scene, and meshes into ``folder``."""

    def __init__(self, robot: Robot, start: Positions, bounds: Mapping[str, JointBounds], folder: Path) -> None:
        self._robot, self._start, self._bounds, self._folder = robot, start, bounds, folder
        self._standing = MovingRobot(robot, start)
        self._parts = ['<robot name="r"><link name="l0"/>']
        self._moving = {robot.model.getJointId(name) for name in bounds}
        self._anchors = self._anchors_of_joints()
        self._meshes = 0
        self._disabled: list[tuple[str, str]] = []
        self._links: list[str] = []

    def build_bare(self) -> PlannerScene:
        """Return a scene without any shape, for the timing of a path."""
        for joint in sorted(self._moving):
            self._add_joint(joint)
        return self._scene()

    def add_tip(self, link: str, up: Array) -> None:
        """Add the frame ``tip`` at the origin of a link. Its z is the axis ``up`` of the link."""
        frame = self._robot.model.frames[self._robot.model.getFrameId(link, pin.FrameType.BODY)]
        joint, at = self._anchors[frame.parentJoint]
        turn = pin.Quaternion.FromTwoVectors(np.array((0.0, 0.0, 1.0)), up).toRotationMatrix()
        self._parts.append(
            f'<link name="tip"/><joint name="at_tip" type="fixed"><parent link="l{joint}"/><child link="tip"/>'
            f"{_origin(at * frame.placement * pin.SE3(turn, np.zeros(3)))}</joint>"
        )

    def build(
        self, things: Sequence[StaticBody], goals: Sequence[Positions], permission: Permission = NO_PERMISSION
    ) -> PlannerScene:
        """Return the scene with the robot and what is around it, without pairs that may touch by ``permission``."""
        self._permission = permission
        self._rough = self._rough_bodies(things, goals)
        for joint in sorted(self._moving):
            self._add_joint(joint)
        for n in range(len(self._robot.bodies)):
            self._add_body(n)
        for n, (thing, near) in enumerate(zip(things, self._near_bodies(things, goals), strict=True)):
            self._add_thing(n, thing, near)
        larger = self._larger_pairs(goals)
        for n in sorted({i for i, _ in larger}):
            self._add_larger(n)
        made = self._scene()
        self._select_pairs(made.scene, larger)
        return made

    def _scene(self) -> PlannerScene:
        scene = Scene("r", loadUrdfSceneDescriptionFromXml("".join([*self._parts, "</robot>"])))
        names = scene.getJointNames()
        scene.importJointLimitsFromConfig(loadJointLimitsConfig(self._limits(names)))
        model = self._robot.model
        return PlannerScene(scene, tuple(model.names[int(each[1:])] for each in names))

    # -- the robot --------------------------------------------------------------------------------------------------

    def _anchors_of_joints(self) -> list[tuple[int, pin.SE3]]:
        """Return for each joint the moving joint that carries it (0 for the root), and its place in that frame."""
        model, found = self._robot.model, [(0, pin.SE3.Identity())]
        for joint in range(1, model.njoints):
            parent, at = found[model.parents[joint]]
            if joint in self._moving:
                found.append((joint, pin.SE3.Identity()))
            else:
                found.append((parent, at * model.jointPlacements[joint] * self._turned(joint)))
        return found

    def _turned(self, joint: int) -> pin.SE3:
        """Return the transformation by the present position of a joint."""
        told = self._robot.tree.joints[self._robot.model.names[joint]]
        axis, position = np.array(told.axis, dtype=float), self._start.get(told.name, 0.0)
        if told.kind is JointKind.PRISMATIC:
            return pin.SE3(np.eye(3), axis * position)
        return pin.SE3(pin.AngleAxis(position, axis).toRotationMatrix(), np.zeros(3))

    def _add_joint(self, joint: int) -> None:
        model = self._robot.model
        told, bound = self._robot.tree.joints[model.names[joint]], self._bounds[model.names[joint]]
        parent, at = self._anchors[model.parents[joint]]
        kind = "prismatic" if told.kind is JointKind.PRISMATIC else "revolute"
        self._parts.append(
            f'<link name="l{joint}"/><joint name="j{joint}" type="{kind}"><parent link="l{parent}"/>'
            f'<child link="l{joint}"/>{_origin(at * model.jointPlacements[joint])}<axis xyz="{_row(told.axis)}"/>'
            f'<limit lower="{bound.lower!r}" upper="{bound.upper!r}" velocity="{bound.speed!r}" effort="1"/></joint>'
        )

    def _add_body(self, n: int) -> None:
        body = self._robot.bodies[n]
        joint, at = self._anchors[body.joint]
        if not self._robot.anchored[n]:
            return  # its place is unknown
        placed = at * self._robot.geometry.geometryObjects[n].placement
        if n in self._rough:
            hull = Shape(body.hull, body.hull, None, pin.SE3.Identity())
            self._add_link(f"b{n}", joint, placed, *inflated(hull, OWN_M))
            return
        surface = body.surface
        mesh = None if surface is None else (surface.vertices, surface.triangles)
        self._add_link(f"b{n}", joint, placed, [(body.shape, pin.SE3.Identity())], mesh)

    def _add_larger(self, n: int) -> None:
        """Add a copy of a part that is larger by the clearance between parts of the robot."""
        body = self._robot.bodies[n]
        joint, at = self._anchors[body.joint]
        placed = at * self._robot.geometry.geometryObjects[n].placement
        self._add_link(f"e{n}", joint, placed, *larger_part(body))

    def _larger_pairs(self, goals: Sequence[Positions]) -> set[tuple[int, int]]:
        """Return the pairs of a mesh and a part without enlarged hulls, of which the first one is to be larger.

        At the start and at the goals they are further apart than that. What is larger is simpler.
        """
        robot, found = self._robot, set[tuple[int, int]]()
        for pair in robot.pairs:
            if not set(pair) & self._rough and all(robot.anchored[i] for i in pair) and self._move_apart(*pair):
                one, other = sorted(pair, key=lambda n: triangles_of(robot.bodies[n]))
                found |= {(one, other)} if robot.bodies[other].surface is not None else set()
        for place in ({}, *goals):
            self._standing.set_positions(moved_positions(robot, self._start, place))  # type: ignore[arg-type]  # of numbers, numbers
            found = {each for each in found if self._apart(*each) > CORNERS * OWN_M}
            self._standing.set_positions(self._start)
        return found

    def _move_apart(self, i: int, k: int) -> bool:
        return self._anchors[self._robot.bodies[i].joint][0] != self._anchors[self._robot.bodies[k].joint][0]

    def _apart(self, i: int, k: int) -> float:
        """Return a lower bound of the distance of two parts, exact where they are near."""
        far_m = self._standing.gap(i, k)
        return far_m if far_m > CORNER_M else distance(self._standing.shape(i), self._standing.shape(k), CORNER_M)

    def _rough_bodies(self, things: Sequence[StaticBody], goals: Sequence[Positions]) -> set[int]:
        """Return the bodies with a mesh whose hulls are near nothing at the start and at the goals."""
        robot, found = self._robot, {n for n, body in enumerate(self._robot.bodies) if body.surface is not None}
        for place in ({}, *goals):
            self._standing.set_positions(moved_positions(robot, self._start, place))  # type: ignore[arg-type]  # of numbers, numbers
            found -= {*self._hulls_near_things(found, things), *self._hulls_near_others(found)}
            self._standing.set_positions(self._start)
        return found

    def _hulls_near_things(self, rough: set[int], things: Sequence[StaticBody]) -> Iterator[int]:
        for n in rough:
            body = self._robot.bodies[n]
            if not self._robot.anchored[n] or not self._anchors[body.joint][0]:
                continue
            hull, near = self._hull(n), (each for each in things if self._standing.gap_to(n, each) < CORNER_M)
            if any(distance(hull, each.shape, CORNER_M) < CORNER_M for each in near):
                yield n

    def _hulls_near_others(self, rough: set[int]) -> Iterator[int]:
        robot, bodies = self._robot, self._robot.bodies
        for i, k in robot.pairs:
            moved = self._anchors[bodies[i].joint][0] != self._anchors[bodies[k].joint][0]
            if not {i, k} & rough or not moved or not robot.anchored[i]:
                continue
            if self._standing.gap(i, k) < PARTS_M and distance(self._hull(i), self._hull(k), PARTS_M) < PARTS_M:
                yield from (i, k)

    def _hull(self, n: int) -> Shape:
        hull = self._robot.bodies[n].hull
        return Shape(hull, hull, None, self._standing.at(n))

    # -- what is around -----------------------------------------------------------------------------------------------

    def _add_thing(self, n: int, thing: StaticBody, near: Mapping[int, float | None]) -> None:
        """Add something around, larger than it is; what is ``near`` compares with one of its own that is less so."""
        moved = self._moved_bodies()
        self._add_inflated(f"o{n}", thing, CLEARANCE_M)
        self._disabled += [(f"b{i}", f"o{n}") for i in moved if i in near or self._permission.allows(i, thing)]
        for i, by_m in near.items():
            if by_m is not None:
                self._add_inflated(f"n{n}x{i}", thing, by_m)
                self._disabled += [(f"b{k}", f"n{n}x{i}") for k in moved if k != i]

    def _moved_bodies(self) -> list[int]:
        return [i for i, body in enumerate(self._robot.bodies) if self._anchors[body.joint][0]]

    def _near_bodies(self, things: Sequence[StaticBody], goals: Sequence[Positions]) -> list[dict[int, float | None]]:
        """Return for each thing the moving bodies near it at the start or at a goal, and how much larger it may be.

        What is larger by a distance has corners that are further out, and no start or goal may be in one. None is for
        what touches at the start.
        """
        found: list[dict[int, float | None]] = [{} for _ in things]
        for place in ({}, *goals):
            self._standing.set_positions(moved_positions(self._robot, self._start, place))  # type: ignore[arg-type]  # of numbers, numbers
            for near, thing in zip(found, things, strict=True):
                self._note_near(near, thing)
            self._standing.set_positions(self._start)
        return found

    def _note_near(self, near: dict[int, float | None], thing: StaticBody) -> None:
        for i in self._moved_bodies():
            if not self._robot.anchored[i] or self._standing.gap_to(i, thing) >= CORNER_M:
                continue
            if self._permission.allows(i, thing):
                continue
            by_m = most_larger(self._standing.shape(i), thing.shape)
            known = near.get(i, CLEARANCE_M)
            if by_m is None or known is None:
                near[i] = None
            elif by_m < known:
                near[i] = by_m

    def _add_inflated(self, name: str, thing: StaticBody, by_m: float) -> None:
        shape: Shape = thing.shape
        self._add_link(name, 0, shape.at, *inflated(shape, by_m))

    def _add_link(
        self,
        name: str,
        joint: int,
        at: pin.SE3,
        solids: list[tuple[coal.CollisionGeometry, pin.SE3]],
        mesh: Triangles | None,
    ) -> None:
        """Add a link with convex ``solids``, or with a surface."""
        parts, convex = [], []
        if mesh is not None:
            parts.append((self._mesh(stl_of(*mesh)), pin.SE3.Identity()))
        else:
            for k, (solid, offset) in enumerate(solids):
                text, is_mesh = self._geometry(solid)
                parts.append((text, offset))
                convex += [f'<convex name="{name}.{k}"/>'] if is_mesh else []
        collisions = "".join(
            f'<collision name="{name}.{k}">{_origin(at * offset)}<geometry>{text}</geometry></collision>'
            for k, (text, offset) in enumerate(parts)
        )
        checking = f"<collision_checking>{''.join(convex)}</collision_checking>" if convex else ""
        self._links.append(name)
        self._parts.append(
            f'<link name="{name}">{collisions}{checking}</link><joint name="f{name}" type="fixed">'
            f'<parent link="l{joint}"/><child link="{name}"/></joint>'
        )

    def _geometry(self, solid: coal.CollisionGeometry) -> tuple[str, bool]:
        """Return a convex shape in URDF, and whether it is a mesh."""
        if isinstance(solid, coal.Box):
            return f'<box size="{_row(2 * np.array(solid.halfSide).reshape(3))}"/>', False
        if isinstance(solid, coal.Sphere):
            return f'<sphere radius="{float(solid.radius)!r}"/>', False
        if isinstance(solid, coal.Cylinder):
            return f'<cylinder radius="{float(solid.radius)!r}" length="{float(2 * solid.halfLength)!r}"/>', False
        return self._mesh(stl_of_hull(solid)), True

    def _mesh(self, stl: bytes) -> str:
        file = self._folder / f"{self._meshes}.stl"
        self._meshes += 1
        file.write_bytes(stl)
        return f'<mesh filename="{file}"/>'

    # -- limits and pairs -------------------------------------------------------------------------------------------

    def _limits(self, joints: Iterable[str]) -> Path:
        """Write the limits that a URDF has no place for."""
        lines = ["joint_limits:\n"]
        for name in joints:
            bound = self._bounds[self._robot.model.names[int(name[1:])]]
            lines.append(f"  {name}: {{max_velocity: [{bound.speed}], max_acceleration: [{bound.acceleration}]}}\n")
        file = self._folder / "limits.yaml"
        file.write_text("".join(lines))
        return file

    def _select_pairs(self, scene: Scene, larger: set[tuple[int, int]]) -> None:
        """Compare the pairs of the robot that the collision check compares, without those that touch at the start."""
        robot, kept = self._robot, set(self._robot.pairs)
        shown = {i: self._anchors[body.joint][0] for i, body in enumerate(robot.bodies) if robot.anchored[i]}
        apart = [(i, k) for i, k in combinations(shown, 2) if shown[i] != shown[k]]
        off = [(i, k) for i, k in apart if not {(i, k), (k, i)} & kept or self._touch(i, k)]
        names = [f"b{i}" for i in shown], [f"e{i}" for i in sorted({i for i, _ in larger})]
        around = [name for name in self._links if name[0] in "on"]
        copies = [(e, name) for e in names[1] for name in (*names[0], *around)] + list(combinations(names[1], 2))
        copied = {(f"e{i}", f"b{k}") for i, k in larger}
        pairs = [*((f"b{i}", f"b{k}") for i, k in [*off, *larger]), *(each for each in copies if each not in copied)]
        scene.setCollisions([*pairs, *self._disabled], False)

    def _touch(self, i: int, k: int) -> bool:
        standing = self._standing
        if standing.gap(i, k) > 0.0:
            return False
        return distance(standing.shape(i), standing.shape(k), TOUCHING_M) <= TOUCHING_M


def _origin(at: pin.SE3) -> str:
    return f'<origin xyz="{_row(at.translation)}" rpy="{_row(pin.rpy.matrixToRpy(at.rotation))}"/>'


def _row(values: Iterable[float]) -> str:
    return " ".join(repr(float(each)) for each in values)
