"""The files that a URDF can make an agent serve, and those that it cannot."""

import hashlib
from pathlib import Path

import pytest

from linked_fleet_agent.mesh_files import MeshError, MeshFiles, MeshRoots, locate_mesh, mesh_files
from linked_fleet_agent.robots.catalogue import MODELS, data_folder
from linked_fleet_agent.settings import SettingsError, read_settings
from linked_fleet_agent.wire.messages import MAX_MESH_BYTES

WAYS = [
    "package://arm/meshes/a.stl",
    "package://arm/urdf/../meshes/a.stl",
    "package://old_name/meshes/a.stl",
    "../meshes/a.stl",
    "meshes/a.stl",
    "{package}/meshes/a.stl",
    "file://{package}/meshes/a.stl",
    "file:{package}/meshes/a.stl",
    "file://localhost{package}/meshes/a.stl",
    "model://arm/meshes/a.stl",
    "package:///meshes/a.stl",
    "package:///arm/meshes/a.stl",
    "package:///share/arm/meshes/a.stl",
    "package:///{package}/meshes/a.stl",
    "package://../meshes/a.stl",
    "package://arm/meshes//a.stl",
    "package://arm/meshes/%61.stl",
    "package://arm/meshes/A.STL",
    "package://arm/Meshes/a.stl",
    "package://arm\\meshes\\a.stl",
    "../../meshes/a.stl",
    "../../../meshes/a.stl",
    "./../meshes/a.stl",
    "..\\meshes\\a.stl",
    "/meshes/a.stl",
]
"""Spellings of the mesh in the package of the URDF."""
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
    "package://secret.stl",
    "package://secret.stl/",
    "package:///secret.stl/.",
    "package://arm/meshes/link.stl",
    "meshes/link.stl",
    "package://arm/%2e%2e/%2e%2e/secret.stl",
    "%2e%2e/%2e%2e/%2e%2e/secret.stl",
    "..\\..\\..\\secret.stl",
    "package://%2e%2e/secret.stl",
    "model://../../secret.stl",
    "file:{outside}",
    "file://localhost{outside}",
    "SECRET.STL",
    "http://127.0.0.1/meshes/a.stl",
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
    for name in ("a.STL", "b.glb", "c.Dae", "d.obj", "f.ply"):
        _put(urdf.parent.parent / "meshes" / name)
    uris = [f"package://arm/meshes/{name}" for name in ("a.STL", "b.glb", "c.Dae", "d.obj", "e.stl", "f.ply")]
    found = mesh_files(_urdf(*map(_visual, uris), '<visual><geometry><sphere radius="1"/></geometry></visual>'), urdf)
    assert [path.name for path in found.values()] == ["a.STL", "b.glb", "c.Dae", "d.obj"]


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


@pytest.fixture
def roots(tmp_path: Path) -> MeshRoots:
    """Return a workspace, an install prefix, and a folder that is a package, each with its own mesh."""
    _put(tmp_path / "workspace" / "hand" / "meshes" / "a.stl")
    _put(tmp_path / "install" / "share" / "gripper" / "meshes" / "b.stl")
    _put(tmp_path / "checkout" / "package.xml", b"<package><name>legs</name></package>")
    _put(tmp_path / "checkout" / "meshes" / "c.stl")
    return MeshRoots((tmp_path / "workspace", tmp_path / "checkout"), (tmp_path / "install",))


@pytest.mark.parametrize(
    ("uri", "file"),
    [
        ("package://hand/meshes/a.stl", "workspace/hand/meshes/a.stl"),
        ("package://Hand/meshes/a.stl", "workspace/hand/meshes/a.stl"),
        ("package://hand/Meshes/A.stl", "workspace/hand/meshes/a.stl"),
        ("package://gripper/meshes/b.stl", "install/share/gripper/meshes/b.stl"),
        ("model://gripper/meshes/b.stl", "install/share/gripper/meshes/b.stl"),
        ("package://legs/meshes/c.stl", "checkout/meshes/c.stl"),
        ("package://checkout/meshes/c.stl", "checkout/meshes/c.stl"),
        ("meshes/c.stl", "checkout/meshes/c.stl"),
        ("hand/meshes/a.stl", "workspace/hand/meshes/a.stl"),
        ("file://{folder}/workspace/hand/meshes/a.stl", "workspace/hand/meshes/a.stl"),
        ("package:///{folder}/workspace/hand/meshes/a.stl", "workspace/hand/meshes/a.stl"),
        ("package://hand/../../secret.stl", None),
        ("../../secret.stl", None),
        ("{folder}/secret.stl", None),
        ("package://hand/meshes/link.stl", None),
    ],
)
@pytest.mark.parametrize("has_file", [True, False])
def test_meshes_come_from_the_roots_too(
    tmp_path: Path, roots: MeshRoots, uri: str, file: str | None, has_file: bool
) -> None:
    """A description without a file, as of a robot of ROS 2, has the roots alone."""
    outside = _put(tmp_path / "secret.stl")
    (tmp_path / "workspace" / "hand" / "meshes" / "link.stl").symlink_to(outside)
    urdf = _put(tmp_path / "elsewhere" / "urdf" / "r.urdf") if has_file else None
    found = locate_mesh(uri.format(folder=tmp_path), urdf, roots)
    assert found == (None if file is None else tmp_path / file)


def test_a_path_relative_to_the_urdf_may_lead_into_a_root(tmp_path: Path, roots: MeshRoots) -> None:
    urdf = _put(tmp_path / "elsewhere" / "urdf" / "r.urdf")
    assert locate_mesh("../../checkout/meshes/c.stl", urdf, roots) == tmp_path / "checkout" / "meshes" / "c.stl"
    assert locate_mesh("../../checkout/meshes/c.stl", urdf) is None


def test_names_that_differ_in_case_only_are_not_guessed(urdf: Path) -> None:
    for name in ("Arm.stl", "ARM.stl"):
        _put(urdf.parent.parent / "meshes" / name)
    assert locate_mesh("package://arm/meshes/arm.stl", urdf) is None
    assert locate_mesh("package://arm/meshes/ARM.stl", urdf) == urdf.parent.parent / "meshes" / "ARM.stl"


def test_the_roots_are_those_of_ros_after_those_of_the_setting() -> None:
    environment = {"ROS_PACKAGE_PATH": "/a:/b", "AMENT_PREFIX_PATH": "/opt/ros/jazzy:/ws/install"}
    roots = MeshRoots.from_environment(["/first"], environment)
    assert roots.folders == (Path("/first"), Path("/a"), Path("/b"))
    assert roots.prefixes == (Path("/opt/ros/jazzy"), Path("/ws/install"))
    assert MeshRoots.from_environment([], {}) == MeshRoots()


def test_a_root_that_is_no_folder_is_refused(tmp_path: Path) -> None:
    environment = {"LINKED_FLEET_MESH_ROOTS": f"{tmp_path}", "LINKED_FLEET_ROBOT": "ur5"}
    assert read_settings([], environment, "host").mesh_roots == MeshRoots((tmp_path,))
    with pytest.raises(SettingsError, match="LINKED_FLEET_MESH_ROOTS: '/nowhere' is not a folder"):
        read_settings(["--mesh-roots", f"{tmp_path},/nowhere"], environment, "host")


def test_meshes_that_are_not_offered_are_logged_once_with_their_reasons(
    urdf: Path, caplog: pytest.LogCaptureFixture
) -> None:
    uris = ["package://arm/a.stl", "package://arm/b.ply", "mesh", "package://arm/c.stl", "package://arm/c.stl"]
    assert mesh_files(_urdf(*map(_visual, uris)), urdf, robot="arm") == {}
    (logged,) = [each.getMessage() for each in caplog.records]
    assert logged.startswith("arm: 4 of 4 meshes are not offered: 'package://arm/a.stl': there is no such file")
    assert ".ply is none of the formats .stl" in logged and logged.endswith("; and 1 more")


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
