"""The files that a URDF can make an agent serve, and those that it cannot."""

import hashlib
from pathlib import Path

import pytest

from linked_fleet_agent.mesh_files import MeshError, MeshFiles, locate_mesh, mesh_files
from linked_fleet_agent.robots.catalogue import MODELS, data_folder
from linked_fleet_agent.wire.messages import MAX_MESH_BYTES

WAYS = [
    "package://arm/meshes/a.stl",
    "package://arm/urdf/../meshes/a.stl",
    "package://old_name/meshes/a.stl",
    "../meshes/a.stl",
    "meshes/a.stl",
    "{package}/meshes/a.stl",
    "file://{package}/meshes/a.stl",
]
ESCAPES = [
    "package://arm/../../secret.stl",
    "../../../secret.stl",
    "package://../secret.stl",
    "package://./secret.stl",
    "secret.stl",
    "{outside}",
    "file://{outside}",
    "package://{outside}",
    "package://arm/{outside}",
    "package:///secret.stl",
    "package://arm",
    "package://arm/meshes/link.stl",
    "meshes/link.stl",
]


def _visual(uri: str) -> str:
    return f'<visual><geometry><mesh filename="{uri}"/></geometry></visual>'


def _urdf(*links: str) -> str:
    inner = "".join(f'<link name="l{index}">{link}</link>' for index, link in enumerate(links))
    return f'<robot name="r">{inner}</robot>'


def _put(path: Path, content: bytes = b"solid") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    """Return the URDF of an ordinary package in an ordinary workspace."""
    _put(tmp_path / "share" / "arm" / "package.xml")
    return _put(tmp_path / "share" / "arm" / "urdf" / "arm.urdf")


def test_the_meshes_of_a_demonstration_robot_are_those_of_its_visuals_and_collisions() -> None:
    file = data_folder() / MODELS["ur5"].file
    found = mesh_files(file.read_text(), file)
    assert ["/visual/" in uri for uri in found] == [True] * 7 + [False] * 7
    assert ["/collision/" in uri for uri in found] == [False] * 7 + [True] * 7
    assert all(path.is_file() and path.name in uri for uri, path in found.items())


def test_meshes_that_show_the_robot_come_before_those_of_its_collision_geometry(urdf: Path) -> None:
    for name in ("a.stl", "b.stl", "c.stl"):
        _put(urdf.parent.parent / "meshes" / name)
    collision = _visual("package://arm/meshes/b.stl").replace("visual", "collision")
    other = _visual("package://arm/meshes/c.stl").replace("visual", "collision")
    found = mesh_files(_urdf(_visual("package://arm/meshes/a.stl") + collision, other), urdf)
    assert list(found) == [f"package://arm/meshes/{name}.stl" for name in "abc"]


def test_other_formats_and_missing_files_are_not_in_the_list(urdf: Path) -> None:
    for name in ("a.STL", "b.glb", "c.Dae", "d.obj"):
        _put(urdf.parent.parent / "meshes" / name)
    uris = [f"package://arm/meshes/{name}" for name in ("a.STL", "b.glb", "c.Dae", "d.obj", "e.stl")]
    found = mesh_files(_urdf(*map(_visual, uris), '<visual><geometry><sphere radius="1"/></geometry></visual>'), urdf)
    assert [path.name for path in found.values()] == ["a.STL", "c.Dae", "d.obj"]


@pytest.mark.parametrize("uri", WAYS)
def test_the_ways_to_name_a_mesh(urdf: Path, uri: str) -> None:
    mesh = _put(urdf.parent.parent / "meshes" / "a.stl")
    assert locate_mesh(uri.format(package=urdf.parent.parent), urdf) == mesh


def test_a_package_beside_that_of_the_urdf(urdf: Path) -> None:
    mesh = _put(urdf.parents[2] / "gripper" / "meshes" / "a.stl")
    assert locate_mesh("package://gripper/meshes/a.stl", urdf) == mesh


def test_a_urdf_that_is_in_no_package_has_its_own_folder(tmp_path: Path) -> None:
    urdf, inside, outside = (tmp_path / each for each in ("here/r.urdf", "here/meshes/a.stl", "b.stl"))
    for path in (urdf, inside, outside):
        _put(path)
    assert locate_mesh("meshes/a.stl", urdf) == inside
    assert locate_mesh("../b.stl", urdf) is None


@pytest.mark.parametrize("uri", ESCAPES)
def test_no_name_leads_out_of_the_package(urdf: Path, uri: str) -> None:
    """Neither dots, nor an absolute path, nor a symbolic link."""
    outside = _put(urdf.parents[3] / "secret.stl")
    link = urdf.parent.parent / "meshes" / "link.stl"
    link.parent.mkdir()
    link.symlink_to(outside)
    assert locate_mesh(uri.format(outside=outside), urdf) is None


@pytest.mark.parametrize("uri", ["", "a" * 5000 + ".stl", "nul\0.stl"])
def test_uris_that_name_no_file_are_ignored(urdf: Path, uri: str) -> None:
    assert locate_mesh(uri, urdf) is None


def test_offered_meshes_have_the_stated_digests_and_can_be_read(tmp_path: Path) -> None:
    path = _put(tmp_path / "a.stl", b"solid a")
    files = MeshFiles("r", {"package://r/a.stl": path})
    (mesh,) = files.offers
    assert (mesh.uri, mesh.size, mesh.type) == ("package://r/a.stl", 7, "model/stl")
    assert mesh.sha256 == hashlib.sha256(b"solid a").hexdigest()
    assert files.read(mesh.sha256.encode()) == b"solid a"


@pytest.mark.parametrize("question", [b"", b"../a.stl", b"a.stl", b"\xff" * 64, b"0" * 64, b"0" * 100_000])
def test_other_questions_are_refused(tmp_path: Path, question: bytes) -> None:
    files = MeshFiles("r", {"a.stl": _put(tmp_path / "a.stl")})
    with pytest.raises(MeshError, match="is not the digest") as refusal:
        files.read(question)
    assert len(str(refusal.value)) < 500


def test_a_file_that_changed_or_went_is_not_handed_out(tmp_path: Path) -> None:
    path = _put(tmp_path / "a.stl", b"before")
    files = MeshFiles("r", {"a.stl": path})
    question = files.offers[0].sha256.encode()
    path.write_bytes(b"behind")
    with pytest.raises(MeshError, match="changed"):
        files.read(question)
    path.unlink()
    with pytest.raises(MeshError, match="cannot be read"):
        files.read(question)


def test_too_large_empty_and_missing_meshes_are_not_offered(tmp_path: Path) -> None:
    large, empty = _put(tmp_path / "large.stl"), _put(tmp_path / "empty.stl", b"")
    with large.open("r+b") as file:
        file.truncate(MAX_MESH_BYTES + 1)
    good = _put(tmp_path / "good.stl")
    paths = {"large.stl": large, "empty.stl": empty, "gone.stl": tmp_path / "gone.stl", "x" * 600: good}
    assert MeshFiles("r", paths).offers == ()
    assert len(MeshFiles("r", paths | {"good.stl": good}).offers) == 1
