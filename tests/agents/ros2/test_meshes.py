"""Meshes of a ROS 2 robot, whose description comes without a file."""

from pathlib import Path

import pytest

from linked_fleet_agent.mesh_files import NO_ROOTS, MeshRoots
from linked_fleet_agent.robots.ros2.address import Address
from linked_fleet_agent.robots.ros2.finding import facts_of, with_meshes
from linked_fleet_agent.robots.ros2.graph import ReceivedMessage
from mesh_package import PACKAGE, robot, write
from ros2_robot import text


@pytest.mark.parametrize(
    ("uri", "name"),
    [
        (f"package://{PACKAGE}/meshes/bar.stl", "bar.stl"),
        (f"package://{PACKAGE}/meshes/bar.glb", "bar.glb"),
        (f"package://{PACKAGE}/meshes/m%20x.stl", "m x.stl"),
        (f"file:///opt/elsewhere/install/share/{PACKAGE}/meshes/bar.stl", "bar.stl"),
        (f"package://{PACKAGE}/meshes/nothere.stl", None),
        ("package://other/../../secret.stl", None),
    ],
)
@pytest.mark.parametrize("place", ["address", "folder", "package", "prefix"])
def test_meshes_are_found_in_the_folders_of_the_address_and_of_the_settings(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, uri: str, name: str | None, place: str
) -> None:
    (tmp_path / "secret.stl").write_bytes(b"solid")
    share = tmp_path / "install" / "share"
    write(share, uri)
    facts = facts_of("arm", ReceivedMessage(text(robot(uri)), 0.0))
    address = Address("tcp/192.0.2.1:7447", meshes=(share,) if place == "address" else ())
    roots = {
        "address": NO_ROOTS,
        "folder": MeshRoots((share,)),
        "package": MeshRoots((share / PACKAGE,)),
        "prefix": MeshRoots((), (share.parent,)),
    }[place]
    found = with_meshes("arm", facts, address, roots).meshes
    if name is None:
        assert found == {} and "1 of 1 meshes are not offered" in caplog.text
    else:
        assert found == {uri: share / PACKAGE / "meshes" / name}
