"""The geometry of a robot: the meshes that its agent hands out, and its URDF with their addresses. Pure."""

from collections.abc import Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.fleet.xml import parse_xml

SUFFIXES: Mapping[str, str] = {"model/stl": "stl", "model/vnd.collada+xml": "dae", "model/obj": "obj"}
"""By media type; a mesh of any other type is as if it were not there."""
MAX_DEPTH = 32


def file_name(mesh: Mesh) -> str:
    return f"{mesh.sha256}.{SUFFIXES[mesh.type]}"


def meshes_of(robot: Robot) -> dict[str, Mesh]:
    """The meshes that the robot's description names, by their URI in its URDF."""
    said = robot.description.meshes if robot.description is not None else ()
    return {mesh.uri: mesh for mesh in said if mesh.type in SUFFIXES}


def drawable(urdf: str, addresses: Mapping[str, str]) -> bytes:
    """The URDF in UTF-8 with each mesh at its address (by URI); visual or collision geometry without one is left out.

    So is whatever makes a browser load or run something: textures, elements and attributes of other vocabularies.
    The time is linear in the length. Raises ModelError for what is no XML.
    """
    root = parse_xml(urdf)
    pending = [(root, 1)]
    while pending:
        element, depth = pending.pop()
        element.attrib = {name: value for name, value in element.attrib.items() if "}" not in name}
        # All at once: to remove one after another would be quadratic.
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
