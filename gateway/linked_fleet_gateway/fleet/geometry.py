"""The geometry of a robot: the meshes that its agent serves, and its URDF with their URLs. Pure."""

from collections.abc import Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.fleet.xml import parse_xml

SUFFIXES: Mapping[str, str] = {
    "model/stl": "stl",
    "model/vnd.collada+xml": "dae",
    "model/obj": "obj",
    "model/gltf-binary": "glb",
}
"""File suffixes by media type; meshes of other types are ignored."""
MAX_DEPTH = 32


def file_name(mesh: Mesh) -> str:
    return f"{mesh.sha256}.{SUFFIXES[mesh.type]}"


def meshes_of(robot: Robot) -> dict[str, Mesh]:
    """Return the meshes in the robot's description, by their URI in its URDF."""
    said = robot.description.meshes if robot.description is not None else ()
    return {mesh.uri: mesh for mesh in said if mesh.type in SUFFIXES}


def urdf_with_mesh_addresses(urdf: str, addresses: Mapping[str, str]) -> bytes:
    """Return the URDF in UTF-8 with the address of each mesh (by URI). Visual or collision geometry without one is
    removed.

    Anything that makes a browser load or execute something is removed too: textures, and foreign elements and
    attributes. The time is linear in the length. Raises ModelError if the text is not XML.
    """
    root = parse_xml(urdf)
    pending = [(root, 1)]
    while pending:
        element, depth = pending.pop()
        element.attrib = {name: value for name, value in element.attrib.items() if "}" not in name}
        # All at once, because removing children one by one would be quadratic.
        element[:] = [child for child in element if depth < MAX_DEPTH and _belongs(child, addresses)]
        pending += [(child, depth + 1) for child in element]
        if element.tag == "mesh":
            element.set("filename", addresses[element.get("filename", "")])
    written: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return written


def _belongs(element: Element, addresses: Mapping[str, str]) -> bool:
    if element.tag in ("visual", "collision"):
        return all(mesh.get("filename") in addresses for mesh in element.findall("geometry/mesh"))
    if element.tag == "mesh":
        return element.get("filename") in addresses
    return element.tag != "texture" and "}" not in element.tag
