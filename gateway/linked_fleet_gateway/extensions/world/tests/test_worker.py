"""Responses of the process that checks motions, and what it caches for the next check."""

import hashlib
from pathlib import Path

from linked_fleet_gateway.extensions.world.messages import (
    Check,
    CheckFailed,
    MeshesMissing,
    MotionPath,
    PathSegment,
    Placement,
    Prepare,
    PrepareMesh,
    Question,
    Ready,
)
from linked_fleet_gateway.extensions.world.surfaces import MeshCache
from linked_fleet_gateway.extensions.world.worker import Worker
from linked_fleet_state.model import Pose
from meshes import BOX, channel, stl

URIS = {"package://r/u.stl": stl(channel()), "package://r/box.stl": stl(BOX)}
MESHES = {f"{hashlib.sha256(content).hexdigest()}.stl": content for content in URIS.values()}
NAMES = dict(zip(URIS, MESHES, strict=True))


def urdf(collision: str = "package://r/u.stl", visual: str = "package://r/box.stl") -> str:
    shapes = (f"<{kind}><geometry><mesh filename='{uri}'/></geometry></{kind}>" for kind, uri in
              (("collision", collision), ("visual", visual)))  # fmt: skip
    return f"<robot name='r'><link name='base'>{''.join(shapes)}</link></robot>"


def prepare(urdf: str) -> Prepare:
    return Prepare("r", urdf, NAMES)


def told(worker: Worker, name: str) -> object:
    return worker.answer(PrepareMesh(name, MESHES[name]))


def test_the_worker_requests_collision_meshes_only() -> None:
    worker = Worker(MeshCache(None))
    name = NAMES["package://r/u.stl"]
    assert worker.answer(prepare(urdf())) == MeshesMissing((name,))
    assert told(worker, name) == Ready()
    assert isinstance(worker.answer(prepare(urdf())), Ready)


def test_visual_geometry_stands_for_meshes_that_are_not_handed_out() -> None:
    assert Worker(MeshCache(None)).answer(prepare(urdf(collision="package://r/none.stl"))) == MeshesMissing(
        (NAMES["package://r/box.stl"],)
    )


def test_another_process_uses_cached_meshes(tmp_path: Path) -> None:
    first = Worker(MeshCache(tmp_path))
    told(first, NAMES["package://r/u.stl"])
    assert isinstance(Worker(MeshCache(tmp_path)).answer(prepare(urdf())), Ready)
    for file in tmp_path.iterdir():
        file.write_bytes(b"damaged")
    assert isinstance(Worker(MeshCache(tmp_path)).answer(prepare(urdf())), MeshesMissing)


def test_meshes_in_memory_are_bounded() -> None:
    worker = Worker(MeshCache(None), most_triangles=len(BOX))
    for name in MESHES:
        told(worker, name)
    assert isinstance(worker.answer(prepare(urdf())), MeshesMissing)
    assert isinstance(worker.answer(prepare(urdf(collision="package://r/box.stl"))), Ready)


def test_an_unusable_message_is_reported_and_the_worker_continues() -> None:
    worker = Worker(MeshCache(None))
    hostile: list[Question] = [
        PrepareMesh(f"{'0' * 64}.stl", b"\xff" * 200),
        PrepareMesh(f"{'0' * 64}.dae", b"<COLLADA>"),
        PrepareMesh("0.exe", b"MZ"),
        Prepare("r", "<robot", {}),
    ]
    for question in hostile:
        assert isinstance(worker.answer(question), CheckFailed), question
    here = Placement("r", "r", Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    assert isinstance(worker.answer(Check(here, (MotionPath({}, (PathSegment({}),)),), (), (), 1.0)), CheckFailed)
