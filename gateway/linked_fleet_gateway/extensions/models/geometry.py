"""The geometry of a robot: the meshes that its agent serves, and its URDF with their URLs."""

from collections.abc import Mapping
from xml.etree import ElementTree

from linked_fleet_agent.urdf.writer import plain_element
from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.api import Robot, RobotModel, robot_path

SUFFIXES: Mapping[str, str] = {
    "model/stl": "stl",
    "model/vnd.collada+xml": "dae",
    "model/obj": "obj",
    "model/gltf-binary": "glb",
}
"""File suffixes by media type; meshes of other types are ignored."""


MODEL, MESHES = "model", "meshes"
"""Segments below a robot."""
SIMPLIFIED = "simplified"
"""Segment below the model: the same with simplified meshes."""


def model_path(robot: str) -> str:
    return robot_path(robot) + MODEL


def simplified_path(robot: str) -> str:
    return f"{model_path(robot)}/{SIMPLIFIED}"


def mesh_path(robot: str, file_name: str) -> str:
    return f"{robot_path(robot)}{MESHES}/{file_name}"


def file_name(mesh: Mesh) -> str:
    return f"{mesh.sha256}.{SUFFIXES[mesh.type]}"


def simplified_name(mesh: Mesh) -> str:
    """Return the file name of the simplified mesh, which is binary glTF."""
    return f"{mesh.sha256}.{SIMPLIFIED}.glb"


def meshes_of(robot: Robot) -> dict[str, Mesh]:
    """Return the meshes in the robot's description, by their URI in its URDF."""
    said = robot.description.meshes if robot.description is not None else ()
    return {mesh.uri: mesh for mesh in said if mesh.type in SUFFIXES}


def urdf_with_mesh_addresses(urdf: str, addresses: Mapping[str, str]) -> bytes:
    """Return the robot as plain URDF in UTF-8 with the address of each mesh (by URI). Visual or collision geometry
    without one is removed.

    Nothing but what our reader has understood is written, so nothing in it makes a browser load or execute something
    else. The time is linear in the length. Raises ModelError if the text is not the description of a robot.
    """
    element = plain_element(RobotModel.for_urdf(urdf), addresses.get)
    written: bytes = ElementTree.tostring(element, encoding="utf-8", xml_declaration=True)
    return written
