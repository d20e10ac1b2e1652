"""Meshes and names on which the process that checks motions ended, or refused a whole robot: each is checked."""

import hashlib
import math

import pytest

from linked_fleet_gateway.extensions.world import surfaces, worker
from linked_fleet_gateway.extensions.world.messages import (
    Check,
    CheckFailed,
    CollisionFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
    Prepare,
    PrepareMesh,
    PrepareObject,
    Ready,
)
from linked_fleet_gateway.extensions.world.scene import Box
from linked_fleet_gateway.extensions.world.surfaces import MeshCache, read_mesh
from linked_fleet_gateway.extensions.world.worker import Worker
from linked_fleet_state.model import Pose
from linked_fleet_state.xml import ModelError
from meshes import BOX, Triangle, plate, stl


def cylinder(sides: int, height: float = 0.2, radius: float = 0.15) -> list[Triangle]:
    """Return a closed cylinder about z, as programs for design write it."""
    ring = [
        (radius * math.cos(2 * math.pi * i / sides), radius * math.sin(2 * math.pi * i / sides)) for i in range(sides)
    ]
    found: list[Triangle] = []
    for (x, y), (u, v) in zip(ring, [*ring[1:], ring[0]], strict=True):
        found += [((x, y, 0), (u, v, 0), (u, v, height)), ((x, y, 0), (u, v, height), (x, y, height))]
        found += [((0, 0, 0), (u, v, 0), (x, y, 0)), ((0, 0, height), (x, y, height), (u, v, height))]
    return found


def scaled(triangles: list[Triangle], by: float, shift: float = 0.0) -> list[Triangle]:
    return [tuple(tuple(by * x + shift for x in point) for point in each) for each in triangles]


MESHES = {
    "flat": plate(0.15),
    "one triangle": [((0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (0.0, 0.15, 0.0))],
    "flat and closed": cylinder(20, height=0.0),
    "thinner than numbers tell": cylinder(50, height=1e-13),
    "very thin": cylinder(50, height=1e-6),
    "a cylinder of 300 sides": cylinder(300),
    "a cylinder of 1000 sides": cylinder(1000),
    "without extent": scaled(BOX, 1e-20),
    "near nothing": [((0.0, 0.0, 0.0), (1e-40, 0.0, 0.0), (0.0, 1e-40, 1e-40))],
    "far away": scaled(BOX, 1.0, 90.0),
}
NEAR = {"flat", "one triangle", "flat and closed", "very thin", "a cylinder of 300 sides", "a cylinder of 1000 sides"}


def urdf(link: str = "tool") -> str:
    return (
        "<robot name='r'><link name='base'><collision><geometry><box size='.1 .1 .1'/></geometry></collision></link>"
        f"<link name='middle'/><link name='{link}'><collision><geometry><mesh filename='m.stl'/></geometry></collision>"
        "</link><joint name='a' type='continuous'><parent link='base'/><child link='middle'/><origin xyz='0 0 .5'/>"
        f"<axis xyz='0 0 1'/></joint><joint name='b' type='continuous'><parent link='middle'/><child link='{link}'/>"
        "<origin xyz='.5 0 0'/><axis xyz='0 0 1'/></joint></robot>"
    )


def prepared(triangles: list[Triangle], link: str = "tool") -> Worker:
    content = stl(triangles)
    made, name = Worker(MeshCache(None)), f"{hashlib.sha256(content).hexdigest()}.stl"
    assert made.answer(PrepareMesh(name, content)) == Ready()
    assert isinstance(made.answer(Prepare("r", urdf(link), {"m.stl": name})), Ready)
    made.answer(PrepareObject("peg", Box((0.05, 0.05, 2.0))))
    return made


def sweep(made: Worker, y: float) -> object:
    """Turn the arm by a quarter among a peg at x = 0 and this y."""
    upright = (0.0, 0.0, 0.0, 1.0)
    peg = Placement("peg", "peg", Pose((0.0, y, 0.0), upright))
    path = MotionPath({"a": 0.0, "b": 0.0}, (PathSegment({"a": math.pi / 2}),))
    robot = Placement("r", "r", Pose((0.0, 0.0, 0.0), upright))
    return made.answer(Check(robot, (path,), (), (peg,), 30.0))


@pytest.mark.parametrize("kind", MESHES)
def test_a_mesh_without_a_convex_hull_is_checked_by_its_surface(kind: str) -> None:
    made = prepared(MESHES[kind])
    assert isinstance(sweep(made, 5.0), Free)
    assert isinstance(sweep(made, 0.55), CollisionFound if kind in NEAR else CollisionFound | Free)


@pytest.mark.parametrize("name", ["the tool", "tool ", " tool", "tool\u00a0x", "werkzeug ä", "tool&amp;x"])
def test_a_link_of_any_name_is_checked(name: str) -> None:
    assert isinstance(sweep(prepared(BOX, name), 0.55), CollisionFound)


def test_a_mesh_of_too_many_triangles_without_a_hull_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surfaces, "MOST_TRIANGLES", 50)
    assert len(read_mesh("stl", stl(cylinder(300))).triangles) == 1200
    monkeypatch.setattr(surfaces, "MOST_SURFACE_TRIANGLES", 1000)
    with pytest.raises(ModelError, match="it has 1200 triangles, more than 1000, and no convex hull"):
        read_mesh("stl", stl(cylinder(300)))


def test_an_error_of_a_library_ends_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ZeroDivisionError

    made = prepared(BOX)
    monkeypatch.setattr(worker, "check", fails)
    assert isinstance(sweep(made, 5.0), CheckFailed)
