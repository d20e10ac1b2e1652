"""Repairs a URDF so that MuJoCo can simulate it. The published description stays the original text.

Every repair is logged with the names of the robot and the link or joint.
"""

import logging
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from linked_fleet_agent.mesh_files import locate_mesh
from linked_fleet_agent.urdf import RobotModel
from linked_fleet_agent.urdf.geometry import MeshShape
from linked_fleet_agent.urdf.poses import Pose, pose_of, rotation
from linked_fleet_agent.urdf.writer import add_origin, plain_element

_log = logging.getLogger(__name__)

FaultOfMesh = Callable[[str], str]
"""Returns why the simulation cannot use the mesh file at a path; empty if it can."""

TINY_MASS_KG = 1e-3
TINY_INERTIA_KG_M2 = 1e-6
_AXES = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))
_CONSTANT_INERTIA = 1e-12
# MuJoCo refuses bodies below its mjMINVAL of 1e-15.
_LEAST_MASS_KG, _LEAST_INERTIA_KG_M2 = 1e-12, 1e-14


def simulable_urdf(
    urdf: str, robot: str, floating: bool, meshes_from: Path | None = None, fault_of: FaultOfMesh | None = None
) -> str:
    """Return the URDF to simulate. Raises UrdfError if ``urdf`` is invalid.

    Meshes are dropped, unless ``meshes_from`` is the path of the URDF file that mesh paths are relative to; and those
    with a fault.
    """
    model = RobotModel.for_urdf(urdf)
    links = {name: replace(link, visuals=()) for name, link in model.links.items()}
    if meshes_from is None:
        return repaired_urdf(plain_element(replace(model, links=links), lambda uri: None), robot, floating)
    usable = _usable_meshes(model, robot, meshes_from, fault_of or (lambda path: ""))
    return repaired_urdf(plain_element(replace(model, links=links), usable.get), robot, floating)


def repaired_urdf(root: ElementTree.Element, robot: str, floating: bool) -> str:
    """Return the URDF for MuJoCo from a plain element that has only the shapes to be loaded."""
    _weld_many_dof_joints(root, robot)
    _rename_world(root)
    _replace_capsules(root)
    _repair_inertias(root, robot, floating)
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(extension, "compiler", fusestatic="false", discardvisual="false", strippath="false")
    return ElementTree.tostring(root, encoding="unicode")


def _usable_meshes(model: RobotModel, robot: str, near: Path, fault_of: FaultOfMesh) -> dict[str, str]:
    """Return the paths of the collision meshes by URI, and log those that are left out."""
    found: dict[str, str] = {}
    for link in model.links.values():
        for shape in link.collisions:
            if not isinstance(shape.geometry, MeshShape) or shape.geometry.uri in found:
                continue
            uri = shape.geometry.uri
            path = mesh_path(uri, near)
            fault = "it is not here or not STL or OBJ" if path is None else fault_of(path)
            if path is not None and not fault:
                found[uri] = path
            else:
                _log.warning("%s: link %s: collision mesh %r is left out: %s", robot, link.name, uri, fault)
    return found


def mesh_path(uri: str, near: Path) -> str | None:
    """Return the path of ``find_mesh`` as text."""
    found = find_mesh(uri, near)
    return None if found is None else str(found)


def find_mesh(uri: str, near: Path) -> Path | None:
    """Return the file of a mesh URI (package, file or relative) of the URDF ``near``, if MuJoCo can read its format."""
    return locate_mesh(uri, near) if Path(uri).suffix.lower() in (".stl", ".obj") else None


def _replace_capsules(root: ElementTree.Element) -> None:
    """Replace capsules, which MuJoCo does not read from URDF, by a cylinder and two spheres."""
    for link in root.findall("link"):
        for part in [*link.findall("collision"), *link.findall("visual")]:
            capsule = part.find("geometry/capsule")
            if capsule is None:
                continue
            radius, length = capsule.get("radius", ""), float(capsule.get("length", ""))
            pose = pose_of(part.find("origin"), f"a shape of link {link.get('name')!r}")
            link.remove(part)
            link.append(_part(part.tag, pose, "cylinder", radius=radius, length=repr(length)))
            for end in (-length / 2, length / 2):
                link.append(_part(part.tag, _along_z(pose, end), "sphere", radius=radius))


def _part(tag: str, pose: Pose, form: str, **size: str) -> ElementTree.Element:
    part = ElementTree.Element(tag)
    add_origin(part, pose)
    ElementTree.SubElement(ElementTree.SubElement(part, "geometry"), form, size)
    return part


def _along_z(pose: Pose, distance_m: float) -> Pose:
    rows = rotation(pose.orientation_xyzw)
    x, y, z = (at + row[2] * distance_m for at, row in zip(pose.position_m, rows, strict=True))
    return Pose((x, y, z), pose.orientation_xyzw)


def _weld_many_dof_joints(root: ElementTree.Element, robot: str) -> None:
    for joint in root.findall("joint"):
        if joint.get("type") in ("floating", "planar"):
            _log.warning("%s: %s joint %s is held still in the simulation", robot, joint.get("type"), joint.get("name"))
            joint.set("type", "fixed")


def _rename_world(root: ElementTree.Element) -> None:
    """Rename a link called world, which MuJoCo would merge into its own world, leaving no root body."""
    names = {link.get("name") for link in root.findall("link")}
    fresh = "world_link"
    while fresh in names:
        fresh += "_"
    for element in root.iter():
        for attribute, tags in (("name", ("link",)), ("link", ("parent", "child"))):
            if element.tag in tags and element.get(attribute) == "world":
                element.set(attribute, fresh)


def _repair_inertias(root: ElementTree.Element, robot: str, floating: bool) -> None:
    moving = _moving_links(root, floating)
    for link in root.findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        if inertial is not None and _mass(inertial) < _LEAST_MASS_KG:
            link.remove(inertial)
            inertial = None
            _log.info("%s: link %s has an inertial without mass; left out", robot, name)
        if inertial is not None:
            _repair_tensor(inertial, robot, name)
        elif name in moving:
            _log.warning("%s: moving link %s has no usable inertial; it gets %g kg", robot, name, TINY_MASS_KG)
            link.append(_tiny_inertial())


def _moving_links(root: ElementTree.Element, floating: bool) -> set[str]:
    """Return the links that a movable joint or a floating base carries directly: MuJoCo requires a mass for each."""
    ends = [(joint.get("type"), joint.find("child")) for joint in root.findall("joint")]
    children = {child.get("link", ""): kind != "fixed" for kind, child in ends if child is not None}
    names = [link.get("name", "") for link in root.findall("link")]
    return {name for name in names if children.get(name, floating)}


def _mass(inertial: ElementTree.Element) -> float:
    mass = inertial.find("mass")
    return 0.0 if mass is None else float(mass.get("value", "0"))


def _repair_tensor(inertial: ElementTree.Element, robot: str, link: str) -> None:
    tensor = inertial.find("inertia")
    if tensor is None:
        tensor = ElementTree.SubElement(inertial, "inertia")
    given = np.array([[float(tensor.get(key, "0")) for key in row] for row in _AXES])
    sound = nearest_physical(given)
    if np.allclose(given, sound, rtol=1e-9, atol=_CONSTANT_INERTIA):
        return
    _log.info("%s: link %s: the inertia is not physical; repaired from %s", robot, link, given.tolist())
    for row, keys in enumerate(_AXES):
        for column, key in enumerate(keys):
            tensor.set(key, repr(float(sound[row, column])))


def nearest_physical(inertia: np.ndarray) -> np.ndarray:
    """Return the nearest physical inertia in kg·m² with the same principal axes.

    All principal moments are positive, and none exceeds the sum of the other two.
    """
    principal, axes = np.linalg.eigh((inertia + inertia.T) / 2.0)
    floor = max(TINY_INERTIA_KG_M2 * 1e-3, 1e-6 * float(np.abs(principal).max()))
    sound = np.sort(np.maximum(principal, floor)) if principal.min() < _LEAST_INERTIA_KG_M2 else principal
    missing = sound[2] - sound[0] - sound[1]
    if missing > 0.0:
        # Slightly more than half each, so that rounding in the text form does not undo it.
        sound = sound + np.array([missing / 2.0, missing / 2.0, 0.0]) * (1.0 + 1e-6)
    return np.asarray(axes @ np.diag(sound) @ axes.T)


def _tiny_inertial() -> ElementTree.Element:
    inertial = ElementTree.Element("inertial")
    ElementTree.SubElement(inertial, "mass", value=repr(TINY_MASS_KG))
    value = repr(TINY_INERTIA_KG_M2)
    ElementTree.SubElement(inertial, "inertia", ixx=value, iyy=value, izz=value, ixy="0", ixz="0", iyz="0")
    return inertial
