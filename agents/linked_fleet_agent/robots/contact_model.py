"""Contacts of robots with objects, with what others hold and with each other, in one MuJoCo model (extra: sim).

The model has no dynamics: robots are put where they are. A robot touches neither itself nor what it holds. Metre,
radian.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from linked_fleet_agent.robots.convex_pieces import Array, Indices, convex_pieces
from linked_fleet_agent.robots.urdf_repair import simulable_urdf
from linked_fleet_agent.urdf import RobotModel
from linked_fleet_agent.urdf.geometry import Box, Cylinder, MeshShape, Sphere
from linked_fleet_agent.urdf.poses import Pose

TOUCH_M = 0.005
"""Shapes that are less deep in each other do not touch: hulls are larger than what they are around."""
MOST_ROBOTS = 28
_OBJECTS, _HELD = 1 << 29, 1 << 30
"""Bits of objects, and of those that robots hold; below them each robot has one."""

Triangles = tuple[Array, Indices]
"""Vertices, and rows of three indices into them."""
MeshOf = Callable[[str], Triangles | None]
"""Returns the surface of a mesh by its URI, None if it cannot be used."""


class Piece(NamedTuple):
    """A convex piece of a mesh of a link: its points, in a frame at ``pose`` in that of the link."""

    link: str
    pose: Pose
    points: Array


@dataclass(frozen=True)
class ContactRobot:
    """A robot: its URDF, and the joints in the order of its positions. Links of a ``hand`` may touch objects.

    ``pieces`` are those of its meshes; ``unused`` are the links of which a mesh is left out.
    """

    name: str
    urdf: str
    joints: tuple[str, ...]
    hand: Collection[str]
    pieces: tuple[Piece, ...]
    unused: tuple[str, ...]

    @classmethod
    def made(
        cls, name: str, urdf: str, joints: Sequence[str], mesh_of: MeshOf, hand: Collection[str] = ()
    ) -> "ContactRobot":
        """Return a robot with the pieces of its meshes, which takes a second or so. Raises UrdfError."""
        pieces, unused = list[Piece](), dict[str, None]()
        for link in RobotModel.for_urdf(urdf).links.values():
            for shape in link.collisions:
                if not isinstance(shape.geometry, MeshShape):
                    continue
                found = mesh_of(shape.geometry.uri)
                if found is None:
                    unused[link.name] = None
                    continue
                vertices, triangles = found
                points = convex_pieces(vertices * np.array(shape.geometry.scale), triangles)
                pieces += [Piece(link.name, shape.origin, each) for each in points]
        return cls(name, urdf, tuple(joints), frozenset(hand), tuple(pieces), tuple(unused))


class Grip(NamedTuple):
    """The link of a robot that holds an object."""

    robot: str
    link: str


@dataclass(frozen=True)
class ContactObject:
    """An object. Its pose is in the world, or in the frame of the link that holds it. Contacts name its ``title``."""

    name: str
    geometry: Box | Sphere | Cylinder | Triangles
    pose: Pose
    held: Grip | None = None
    title: str = ""


class Contact(NamedTuple):
    """The deepest contact of a robot, by one of its links or what it holds, with another robot or an object.

    ``what`` says both in words; ``other`` is the name of a robot or of an object.
    """

    robot: str
    other: str
    depth_m: float
    what: str


@dataclass(frozen=True)
class _Owner:
    """The owner of a shape: a link of a robot, or an object, which a robot may hold."""

    robot: str
    link: str = ""
    object: ContactObject | None = None
    hand: bool = False

    @property
    def words(self) -> str:
        if self.object is None:
            return f"{self.link} of {self.robot}"
        return f"{self.object.title}, which {self.robot} holds," if self.robot else self.object.title


class ContactModel:
    """The model of at most ``MOST_ROBOTS`` robots, and of objects. Raises ValueError if MuJoCo cannot build it."""

    def __init__(self, robots: Sequence[ContactRobot], objects: Sequence[ContactObject]) -> None:
        self.objects = objects
        spec = mujoco.MjSpec()
        bits = {each.name: 1 << n for n, each in enumerate(robots)}
        every = sum(bits.values())
        self._owners: dict[str, _Owner] = {}
        for robot in robots:
            self._add_robot(spec, robot, bits[robot.name], (every & ~bits[robot.name]) | _OBJECTS)
        for n, each in enumerate(objects):
            self._add_object(spec, n, each, every & ~(bits.get(each.held.robot, 0) if each.held else 0))
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._addresses = {each.name: self._addresses_of(each) for each in robots}
        self._of_geom = [self._owners.get(self._model.geom(n).name) for n in range(self._model.ngeom)]

    # -- making it ----------------------------------------------------------------------------------------------------

    def _add_robot(self, spec: mujoco.MjSpec, robot: ContactRobot, bit: int, others: int) -> None:
        child = mujoco.MjSpec.from_string(simulable_urdf(robot.urdf, robot.name, floating=False))
        for geom in child.geoms:
            geom.name = f"{geom.parent.name} {len(self._owners)}"
            self._own(f"{robot.name}/{geom.name}", robot, geom.parent.name)
        for piece in robot.pieces:
            name = f"{piece.link} {len(self._owners)}"
            geom = self._add_points(child, child.body(piece.link) or child.worldbody, name, piece.points)
            geom.pos, geom.quat = piece.pose.position_m, _wxyz(piece.pose)
            self._own(f"{robot.name}/{name}", robot, piece.link)
        for geom in child.geoms:
            geom.contype, geom.conaffinity, geom.mass = bit, others, 0.0
        base = _free_body(spec, f"base of {robot.name}")
        spec.attach(child, prefix=f"{robot.name}/", frame=base.add_frame())

    def _own(self, geom: str, robot: ContactRobot, link: str) -> None:
        self._owners[geom] = _Owner(robot.name, link, hand=link in robot.hand)

    def _add_object(self, spec: mujoco.MjSpec, n: int, each: ContactObject, robots: int) -> None:
        if each.held is None:
            body = spec.worldbody.add_body(name=f"object {n}", pos=each.pose.position_m, quat=_wxyz(each.pose))
        else:
            body = _free_body(spec, f"object {n}")
        for geom in self._geoms(spec, body, each.geometry):
            geom.name = f"object {len(self._owners)}"
            held = each.held
            geom.contype = _OBJECTS if held is None else _HELD
            geom.conaffinity = robots if held is None else robots | _OBJECTS | _HELD
            self._owners[geom.name] = _Owner("" if held is None else held.robot, object=each)

    def _geoms(
        self, spec: mujoco.MjSpec, body: mujoco.MjsBody, form: Box | Sphere | Cylinder | Triangles
    ) -> Iterator[mujoco.MjsGeom]:
        kind = mujoco.mjtGeom
        if isinstance(form, Box):
            yield body.add_geom(type=kind.mjGEOM_BOX, size=[each / 2 for each in form.size_m])
        elif isinstance(form, Sphere):
            yield body.add_geom(type=kind.mjGEOM_SPHERE, size=[form.radius_m, 0, 0])
        elif isinstance(form, Cylinder):
            yield body.add_geom(type=kind.mjGEOM_CYLINDER, size=[form.radius_m, form.length_m / 2, 0])
        else:
            for k, points in enumerate(convex_pieces(*form)):
                yield self._add_points(spec, body, f"{body.name} {k}", points)

    def _add_points(self, spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, points: Array) -> mujoco.MjsGeom:
        mesh = spec.add_mesh(name=name, uservert=points.ravel().tolist())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # of thin pieces, whose masses do not matter
        return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, name=name)

    def _addresses_of(self, robot: ContactRobot) -> list[tuple[int, int]]:
        """Return the places of joints among positions of the robot and in those of the model."""
        known = {self._model.joint(n).name: int(self._model.jnt_qposadr[n]) for n in range(self._model.njnt)}
        paths = [f"{robot.name}/{name}" for name in robot.joints]
        return [(n, known[path]) for n, path in enumerate(paths) if path in known]

    # -- using it -----------------------------------------------------------------------------------------------------

    def place(self, robot: str, placement: Pose, positions: Sequence[float], base: Pose | None = None) -> None:
        """Put a robot where it is; positions that are not known (NaN) stay as they were.

        ``base`` is the pose of its root link in the frame that is placed, if that is another one.
        """
        self._put(f"base of {robot}", placement if base is None else _composed(placement, base))
        for n, address in self._addresses[robot]:
            if np.isfinite(positions[n]):
                self._data.qpos[address] = positions[n]

    def _put(self, body: str, pose: Pose) -> None:
        address = int(self._model.jnt_qposadr[self._model.body(body).jntadr[0]])
        self._data.qpos[address : address + 7] = (*pose.position_m, *_wxyz(pose))

    def contacts(self) -> list[Contact]:
        """Return the deepest contact of each robot with each other thing."""
        mujoco.mj_kinematics(self._model, self._data)
        if self._move_held():
            mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        deepest: dict[tuple[str, str], Contact] = {}
        for each in self._data.contact:
            owners = (self._of_geom[each.geom1], self._of_geom[each.geom2])
            for one, other in (owners, owners[::-1]):
                found = None if one is None or other is None else _contact(one, other, -float(each.dist))
                if found is None:
                    continue
                known = deepest.setdefault((found.robot, found.other), found)
                if found.depth_m > known.depth_m:
                    deepest[found.robot, found.other] = found
        return list(deepest.values())

    def _move_held(self) -> bool:
        moved = False
        for n, each in enumerate(self.objects):
            if each.held is None:
                continue
            link = self._data.body(f"{each.held.robot}/{each.held.link}")
            w, x, y, z = link.xquat.tolist()
            self._put(f"object {n}", _composed(Pose(tuple(link.xpos.tolist()), (x, y, z, w)), each.pose))
            moved = True
        return moved


def _contact(one: _Owner, other: _Owner, depth_m: float) -> Contact | None:
    """Return the contact as that of the robot to which ``one`` belongs; None if there is none."""
    if not one.robot or depth_m <= TOUCH_M or (one.hand and other.object is not None):
        return None
    name = other.object.name if other.object is not None else other.robot
    return Contact(one.robot, name, depth_m, f"{one.words} touches {other.words}".rstrip(","))


def _free_body(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
    """Add a body that can be put anywhere. MuJoCo compares no two bodies that are fixed to the world."""
    body = spec.worldbody.add_body(name=name, mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True)
    body.add_freejoint()
    return body


def _wxyz(pose: Pose) -> tuple[float, float, float, float]:
    x, y, z, w = pose.orientation_xyzw
    return (w, x, y, z)


def _composed(outer: Pose, inner: Pose) -> Pose:
    """Return the pose of something at ``inner`` in a frame at ``outer``."""
    shift, turn = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(shift, np.array(inner.position_m), np.array(_wxyz(outer)))
    mujoco.mju_mulQuat(turn, np.array(_wxyz(outer)), np.array(_wxyz(inner)))
    (x, y, z), (w, i, j, k) = (shift + np.array(outer.position_m)).tolist(), turn.tolist()
    return Pose((x, y, z), (i, j, k, w))
