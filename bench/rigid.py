"""An independent collision check: kinematics in NumPy, contacts by FCL. In m and rad.

It shares only the reading of mesh files and the list of compared parts with the gateway's check.
"""

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import fcl
import numpy as np
import numpy.typing as npt

from linked_fleet_agent.mesh_files import locate_mesh
from linked_fleet_gateway.extensions.world.surfaces import read_mesh

Array = npt.NDArray[np.float64]
_MOVES = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Joint:
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    limits: tuple[float, float]
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True)
class Part:
    """A collision element. All its points are within ``radius`` of ``centre``, in its own frame."""

    link: str
    origin: Array
    shape: fcl.CollisionGeometry
    centre: Array
    radius: float


class Rigid:
    """The parts of a URDF file in order, and their poses."""

    def __init__(self, file: Path) -> None:
        root = ElementTree.parse(file).getroot()  # noqa: S314 - from an installed package
        self.joints = {each.get("name", ""): _joint(each) for each in root.findall("joint")}
        self.parts = [_part(link, each, file) for link in root.findall("link") for each in link.findall("collision")]
        self.above = {joint.child: name for name, joint in self.joints.items()}
        self._moved: dict[str, tuple[float, Array]] = {}

    def free(self) -> list[str]:
        """Return the joints that a motion may have as targets."""
        return [name for name, joint in self.joints.items() if joint.kind in _MOVES and joint.mimic is None]

    def complete(self, positions: Mapping[str, float]) -> dict[str, float]:
        """Return the positions, with those of joints that mimic others."""
        found = dict(positions)
        for name, joint in self.joints.items():
            if joint.mimic is not None:
                other, factor, offset = joint.mimic
                found[name] = factor * found.get(other, 0.0) + offset
        return found

    def chain(self, link: str) -> set[str]:
        """Return the joints between the root and a link."""
        found: set[str] = set()
        while (name := self.above.get(link)) is not None:
            found.add(name)
            link = self.joints[name].parent
        return found

    def places(self, positions: Mapping[str, float]) -> list[Array]:
        """Return the pose of each part in the root frame, as 4 by 4 matrices."""
        known: dict[str, Array] = {}

        def place(link: str) -> Array:
            if link not in known:
                name = self.above.get(link)
                if name is None:
                    known[link] = np.eye(4)
                else:
                    known[link] = place(self.joints[name].parent) @ self._step(name, positions.get(name, 0.0))
            return known[link]

        return [place(part.link) @ part.origin for part in self.parts]

    def _step(self, name: str, position: float) -> Array:
        """Return the transformation from the parent of a joint to its child."""
        held = self._moved.get(name)
        if held is None or held[0] != position:
            joint = self.joints[name]
            held = self._moved[name] = position, joint.origin @ _moved(joint, position)
        return held[1]


def _joint(element: Element) -> Joint:
    limit, mimic, axis = element.find("limit"), element.find("mimic"), element.find("axis")
    kind = element.get("type", "")
    bounded = limit is not None and kind != "continuous"
    low, high = (float(limit.get(end, "0")) if bounded and limit is not None else sign * math.pi
                 for end, sign in (("lower", -1), ("upper", 1)))  # fmt: skip
    return Joint(
        kind,
        element.find("parent").get("link", ""),  # type: ignore[union-attr]
        element.find("child").get("link", ""),  # type: ignore[union-attr]
        _origin(element),
        _numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0")),
        (low, high),
        None
        if mimic is None
        else (mimic.get("joint", ""), float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))),
    )


def _part(link: Element, element: Element, file: Path) -> Part:
    form = next(iter(element.find("geometry") or ()))
    if form.tag == "mesh":
        path = locate_mesh(form.get("filename", ""), file)
        assert path is not None, form.get("filename")
        mesh = read_mesh(path.suffix[1:].lower(), path.read_bytes())
        vertices = mesh.vertices * _numbers(form.get("scale", "1 1 1"))
        shape = fcl.BVHModel()
        shape.beginModel(len(vertices), len(mesh.triangles))
        shape.addSubModel(vertices, mesh.triangles)
        shape.endModel()
        centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        radius = float(np.linalg.norm(vertices - centre, axis=1).max())
    else:
        centre = np.zeros(3)
        if form.tag == "box":
            size = _numbers(form.get("size", ""))
            shape, radius = fcl.Box(*size), float(np.linalg.norm(size)) / 2
        elif form.tag == "sphere":
            radius = float(form.get("radius", ""))
            shape = fcl.Sphere(radius)
        else:
            wide, length = float(form.get("radius", "")), float(form.get("length", ""))
            shape, radius = fcl.Cylinder(wide, length), math.hypot(wide, length / 2)
    return Part(link.get("name", ""), _origin(element), shape, centre, radius)


def _origin(element: Element) -> Array:
    found, origin = np.eye(4), element.find("origin")
    if origin is not None:
        roll, pitch, yaw = _numbers(origin.get("rpy", "0 0 0"))
        found[:3, :3] = _turn("z", yaw) @ _turn("y", pitch) @ _turn("x", roll)
        found[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
    return found


def _turn(axis: str, angle: float) -> Array:
    return _about(np.array([axis == each for each in "xyz"], dtype=float), angle)


def _about(axis: Array, angle: float) -> Array:
    """Return a rotation matrix (Rodrigues' formula)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    found: Array = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return found


def _moved(joint: Joint, position: float) -> Array:
    found = np.eye(4)
    if joint.kind == "prismatic":
        found[:3, 3] = joint.axis / np.linalg.norm(joint.axis) * position
    elif joint.kind in ("revolute", "continuous"):
        found[:3, :3] = _about(joint.axis, position)
    return found


def _numbers(text: str) -> Array:
    return np.array([float(each) for each in text.split()])


class Around:
    """The compared pairs of parts and their distances: within one robot, and to everything around it."""

    def __init__(self, rigid: Rigid, own: Sequence[tuple[int, int]], still: Sequence[tuple[Part, Array]]) -> None:
        self.rigid = rigid
        self._objects = [fcl.CollisionObject(part.shape) for part in rigid.parts]
        self._still = [fcl.CollisionObject(part.shape, _transform(at)) for part, at in still]
        self._centres = np.array([_centre(part, at) for part, at in still]).reshape(-1, 3)
        self._still_radii = np.array([part.radius for part, _ in still])
        self._radii = np.array([part.radius for part in rigid.parts])
        self._all = self._own = np.array(own, dtype=int).reshape(-1, 2)
        self._moved = self._stale = np.ones(len(rigid.parts), dtype=bool)
        self._middles = np.array([part.centre for part in rigid.parts])

    def moving(self, joints: Set[str]) -> None:
        """From now on, compare only the pairs that these joints move relative to each other."""
        moved = [frozenset(joints & self.rigid.chain(part.link)) for part in self.rigid.parts]
        self._stale = np.ones(len(moved), dtype=bool)
        self._moved = np.array([bool(each) for each in moved], dtype=bool)
        self._own = self._all[[moved[i] != moved[j] for i, j in self._all.tolist()]]

    def near(self, positions: Mapping[str, float], within_m: float) -> Iterator[tuple[tuple[int, int], bool, float]]:
        """Yield pairs within a distance: which, whether both belong to the robot, and how far; zero for a contact."""
        places = np.array(self.rigid.places(positions))
        centres = np.einsum("nij,nj->ni", places[:, :3, :3], self._middles) + places[:, :3, 3]
        for n in np.nonzero(self._moved | self._stale)[0]:
            self._objects[n].setTransform(_transform(places[n]))
        self._stale = self._moved
        i, j = self._own.T
        gaps = np.linalg.norm(centres[i] - centres[j], axis=1) - self._radii[i] - self._radii[j]
        for n in np.nonzero(gaps <= within_m)[0]:
            apart = _distance(self._objects[i[n]], self._objects[j[n]])
            if apart <= within_m:
                yield (int(i[n]), int(j[n])), True, apart
        if len(self._still):
            between = np.linalg.norm(centres[:, None] - self._centres[None], axis=2)
            close = (between - self._radii[:, None] - self._still_radii <= within_m) & self._moved[:, None]
            for a, b in zip(*np.nonzero(close), strict=True):
                apart = _distance(self._objects[a], self._still[b])
                if apart <= within_m:
                    yield (int(a), int(b)), False, apart


def _centre(part: Part, at: Array) -> Array:
    found: Array = at[:3, :3] @ part.centre + at[:3, 3]
    return found


def _transform(at: Array) -> fcl.Transform:
    return fcl.Transform(at[:3, :3], at[:3, 3])


def _distance(one: fcl.CollisionObject, other: fcl.CollisionObject) -> float:
    return max(0.0, float(fcl.distance(one, other, fcl.DistanceRequest(), fcl.DistanceResult())))
