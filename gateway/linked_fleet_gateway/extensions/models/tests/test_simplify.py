"""Simplified meshes: the same shape and colours with fewer triangles, made once, or the mesh itself."""

import asyncio
import hashlib
import io
import math
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager

import numpy as np
import pytest
import trimesh

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_base.errors import Busy, Offline
from linked_fleet_gateway.extensions.models import simplified
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.models.simplified import SimplifiedMeshes
from linked_fleet_gateway.extensions.models.simplify import simplify
from linked_fleet_gateway.extensions.models.simplify_messages import (
    MAX_TRIANGLES,
    Simplified,
    Simplify,
    SimplifyFailed,
)
from linked_fleet_state.events import Frames
from linked_fleet_state.robot import Robot
from mesh_package import BAR, collada, glb
from meshes import Triangle, stl

LOW, HIGH = (-0.03, -0.03, 0.0), (0.03, 0.03, 0.3)
RED = (
    '<library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert><diffuse><color>1 0 0 0.5</color>'
    "</diffuse></lambert></technique></profile_COMMON></effect></library_effects>"
    '<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>'
)
BIND = (
    '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="s" target="#m"/>'
    "</technique_common></bind_material></instance_geometry>"
)


def red(text: str) -> bytes:
    """Return the COLLADA document with a half transparent red material."""
    text = text.replace("<library_geometries>", RED + "<library_geometries>")
    text = text.replace('<triangles count="12">', '<triangles count="12" material="s">')
    return text.replace('<instance_geometry url="#g"/>', BIND).encode()


def scene(suffix: str, content: bytes) -> trimesh.Scene:
    answer = simplify(Simplify(suffix, content))
    assert isinstance(answer, Simplified), answer
    return trimesh.load_scene(io.BytesIO(answer.content), file_type="glb")


def triangles(found: trimesh.Scene) -> int:
    return sum(len(each.faces) for each in found.geometry.values())


def wavy(steps: int, open_edge: bool = False) -> list[Triangle]:
    """Return a ball with waves, of about 2 × ``steps``² triangles; without its last meridian it is not closed."""
    grid = [
        [
            (r * math.sin(v) * math.cos(u), r * math.sin(v) * math.sin(u), r * math.cos(v))
            for v in np.linspace(0, math.pi, steps + 1)
            for r in [1 + 0.1 * math.sin(5 * u) * math.sin(5 * v)]
        ]
        for u in np.linspace(0, 2 * math.pi, steps + 1)
    ]
    found: list[Triangle] = []
    for i in range(steps - open_edge):
        for j in range(steps):
            a, b, c, d = grid[i][j], grid[i + 1][j], grid[i + 1][j + 1], grid[i][j + 1]
            found += [(a, d, c), (a, c, b)]
    return found


@pytest.mark.parametrize(
    ("suffix", "content"),
    [
        ("stl", stl(BAR)),
        ("dae", collada(BAR, 0.01).encode()),
        ("dae", collada(BAR, 0.0254).encode()),
        ("dae", collada(BAR, None).encode()),
        ("dae", collada(BAR, 0.01, "Y_UP").encode()),
        ("dae", red(collada(BAR, 0.001))),
        ("glb", glb(BAR)),
        ("obj", b"\n".join(b"v %f %f %f" % point for each in BAR for point in each)
         + b"".join(b"\nf %d %d %d" % (i, i + 1, i + 2) for i in range(1, 37, 3))),
    ],
)  # fmt: skip
def test_small_meshes_of_each_format_and_unit_stay_as_they_are(suffix: str, content: bytes) -> None:
    found = scene(suffix, content)
    assert triangles(found) == 12
    assert np.allclose(found.bounds, (LOW, HIGH), atol=1e-6)


@pytest.mark.parametrize("open_edge", [False, True])
def test_many_triangles_become_few_and_the_shape_stays(open_edge: bool) -> None:
    made = wavy(200, open_edge)
    found = scene("stl", stl(made))
    assert triangles(found) < 1.1 * MAX_TRIANGLES
    corners = np.array([point for each in made for point in each])
    assert np.abs(found.bounds - (corners.min(0), corners.max(0))).max() < 0.02
    left = np.concatenate([each.vertices for each in found.geometry.values()])
    direction = left / np.linalg.norm(left, axis=1)[:, None]
    u, v = np.arctan2(direction[:, 1], direction[:, 0]), np.arccos(direction[:, 2])
    assert np.abs(np.linalg.norm(left, axis=1) - (1 + 0.1 * np.sin(5 * u) * np.sin(5 * v))).max() < 0.02


def test_colours_are_kept_and_a_mesh_without_one_has_no_material() -> None:
    (coloured,) = scene("dae", red(collada(BAR, 1.0))).geometry.values()
    assert list(coloured.visual.material.main_color) == [255, 0, 0, 128]
    for suffix, content in (("stl", stl(BAR)), ("dae", collada(BAR, 1.0).encode()), ("glb", glb(BAR))):
        answer = simplify(Simplify(suffix, content))
        assert isinstance(answer, Simplified)
        assert b'"materials"' not in answer.content, suffix


@pytest.mark.parametrize(
    ("suffix", "content"),
    [
        ("stl", b""),
        ("stl", b"\0" * 80 + b"\xff\xff\xff\x7f"),
        ("dae", b"<COLLADA"),
        ("dae", b"<a/>"),
        ("dae", collada(BAR, 1.0).replace("</float_array>", " nan</float_array>").encode()),
        ("obj", b"f 1 2 3"),
        ("obj", b"v 0 0 0"),
        ("glb", b"glTF"),
        ("glb", glb(BAR).replace(b'"byteLength"', b'"uri":"a.bin","byteLength"')),
    ],
)
def test_what_cannot_be_read_has_a_reason(suffix: str, content: bytes) -> None:
    answer = simplify(Simplify(suffix, content))
    assert isinstance(answer, SimplifyFailed)
    assert answer.reason


class Shop:
    """Simplified meshes of one robot that has ``contents``."""

    def __init__(self, *contents: bytes, module: str = SimplifiedMeshes.MODULE) -> None:
        self.contents = {hashlib.sha256(each).hexdigest(): each for each in contents}
        self.asked = 0
        self.simplified = SimplifiedMeshes(Meshes(self._ask), module)

    async def _ask(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        self.asked += 1
        return self.contents[mesh.sha256]


@asynccontextmanager
async def opened(*contents: bytes) -> AsyncIterator[Shop]:
    shop = Shop(*contents)
    async with aclosing(shop.simplified):
        yield shop


def _mesh(content: bytes) -> Mesh:
    return Mesh(uri="a.stl", sha256=hashlib.sha256(content).hexdigest(), size=len(content), type="model/stl")


def _robot(online: bool = True) -> Robot:
    robot = Robot("r", lambda *_: None, Frames())
    robot.set_online(online)
    return robot


@pytest.mark.processes
async def test_a_mesh_is_simplified_once_and_then_served_without_the_robot() -> None:
    content, robot = stl(wavy(60)), _robot()
    async with opened(content) as shop:
        mesh = _mesh(content)
        first, *others = await asyncio.gather(*(shop.simplified.get(robot, mesh) for _ in range(5)))
        assert first is not None
        assert all(each is first for each in others)
        assert len(first.body) < mesh.size / 2
        robot.set_online(False)
        assert await shop.simplified.get(robot, mesh) is first
        assert shop.asked == 1


@pytest.mark.processes
async def test_what_cannot_be_simplified_is_none_and_is_not_tried_again() -> None:
    async with opened(b"nothing", stl(BAR)) as shop:
        for _ in range(2):
            assert await shop.simplified.get(_robot(), _mesh(b"nothing")) is None
        assert shop.asked == 1
        assert await shop.simplified.get(_robot(), _mesh(stl(BAR))) is not None


async def test_the_mesh_of_an_offline_robot_is_refused_like_the_mesh_itself() -> None:
    async with opened(stl(BAR)) as shop:
        with pytest.raises(Offline):
            await shop.simplified.get(_robot(online=False), _mesh(stl(BAR)))


@pytest.mark.processes
async def test_a_process_that_ends_costs_the_simplified_mesh_only() -> None:
    shop = Shop(stl(BAR), module="linked_fleet_gateway.extensions.models.geometry")  # ends at once
    async with aclosing(shop.simplified):
        assert await shop.simplified.get(_robot(), _mesh(stl(BAR))) is None


@pytest.mark.processes
async def test_the_same_bytes_under_another_type_do_not_spoil_a_mesh() -> None:
    content = stl(BAR)
    async with opened(content) as shop:
        lying = Mesh(uri="a.obj", sha256=_mesh(content).sha256, size=len(content), type="model/obj")
        assert await shop.simplified.get(_robot(), lying) is None
        assert await shop.simplified.get(_robot(), _mesh(content)) is not None


async def test_one_robot_does_not_keep_others_from_simplified_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simplified, "MAX_UNDER_WAY_OF_A_ROBOT", 2)
    shop, never = Shop(), asyncio.Event()

    async def wait(robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        await never.wait()
        return b""

    shop.simplified = SimplifiedMeshes(Meshes(wait))
    async with aclosing(shop.simplified):
        waiting = [asyncio.create_task(shop.simplified.get(_robot(), _mesh(each))) for each in (b"a", b"b")]
        await asyncio.sleep(0)
        with pytest.raises(Busy):
            await shop.simplified.get(_robot(), _mesh(b"c"))
        other = Robot("other", lambda *_: None, Frames())
        other.set_online(True)
        waiting.append(asyncio.create_task(shop.simplified.get(other, _mesh(b"c"))))
        await asyncio.sleep(0)
        assert not any(each.done() for each in waiting)
        for each in waiting:
            each.cancel()
