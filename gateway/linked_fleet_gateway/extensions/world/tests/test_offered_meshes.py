"""From the file of a URDF over the agent's offer to the shape that is checked: the same bar, or a named link."""

import math
from pathlib import Path

import numpy as np
import pytest

from linked_fleet_agent.mesh_files import MeshFiles, mesh_files
from linked_fleet_gateway.extensions.models.geometry import file_name
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CheckFailed,
    CollisionFound,
    Free,
    MeshesMissing,
    MotionPath,
    PathSegment,
    Placement,
    Prepare,
    PrepareMesh,
    PrepareObject,
    Ready,
)
from linked_fleet_gateway.extensions.world.scene import Box
from linked_fleet_gateway.extensions.world.surfaces import MeshCache
from linked_fleet_gateway.extensions.world.worker import Worker
from linked_fleet_state.model import Pose
from mesh_package import write

P = "package://p-with-dashes/meshes/"
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def prepared(worker: Worker, file: Path) -> Ready:
    """Prepare the robot as the gateway does: with the meshes that the agent offers."""
    urdf = file.read_text()
    files = MeshFiles("r", mesh_files(urdf, file, robot="r"))
    names, unusable = {mesh.uri: file_name(mesh) for mesh in files.offers}, dict[str, str]()
    contents = {file_name(mesh): files.read(mesh.sha256.encode()) for mesh in files.offers}
    answer: Answer = MeshesMissing(())
    while isinstance(answer, MeshesMissing):
        for name in answer.meshes:
            read = worker.answer(PrepareMesh(name, contents[name]))
            unusable |= {name: read.reason} if isinstance(read, CheckFailed) else {}
        answer = worker.answer(Prepare("r", urdf, names, unusable))
    assert isinstance(answer, Ready)
    return answer


def lowered(worker: Worker) -> Answer:
    """Turn the bar from upright to level, where its end meets a peg."""
    worker.answer(PrepareObject("peg", Box((0.02, 0.02, 0.02))))
    path = MotionPath({"j": 0.0}, (PathSegment({"j": math.pi / 2}),))
    robot, peg = Placement("r", "r", Pose((0.0,) * 3, UPRIGHT), (), True), Pose((0.28, 0.0, 0.4), UPRIGHT)
    return worker.answer(Check(robot, (path,), (), (Placement("peg", "peg", peg),), 30.0))


@pytest.mark.parametrize(
    "uri",
    [
        P + "bar.stl", P + "bar.glb", P + "bar_cm.dae", P + "m%20x.stl", P + "m x.stl", "../meshes/bar.stl",
        P + "BAR.STL", "model://p-with-dashes/meshes/bar.stl", "package:///meshes/bar.stl", "../../meshes/bar.glb",
    ],
)  # fmt: skip
def test_a_mesh_is_the_same_shape_in_each_format_unit_and_spelling(tmp_path: Path, uri: str) -> None:
    worker = Worker(MeshCache(None))
    assert prepared(worker, write(tmp_path, uri)).unchecked == ()
    (body,) = worker._robots["r"].bodies
    assert body.centre == pytest.approx(np.array([0.0, 0.0, 0.15]), abs=1e-6)
    assert body.radius == pytest.approx(math.hypot(0.03, 0.03, 0.15), rel=1e-5)
    assert isinstance(lowered(worker), CollisionFound)


@pytest.mark.parametrize("uri", [P + "nothere.stl", "package://other/x.stl", "bar.ply", P + "broken.dae", ""])
def test_a_link_without_a_usable_mesh_is_named_and_never_silently_free(tmp_path: Path, uri: str) -> None:
    file = write(tmp_path, uri)
    (file.parents[1] / "meshes" / "broken.dae").write_bytes(b"<COLLADA>")
    worker = Worker(MeshCache(None))
    (unchecked,) = prepared(worker, file).unchecked
    assert (unchecked.link, unchecked.mesh) == ("tool", uri) and unchecked.reason
    answer = lowered(worker)
    assert isinstance(answer, Free) and not answer.covered, "only because the placement accepts it"
