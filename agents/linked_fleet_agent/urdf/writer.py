"""Writes a model as plain URDF 1.0, the only form that Pinocchio, MuJoCo and the pages get to read.

So one robot has one kinematics everywhere: orientations are ``rpy``, limits finite, names stripped, unusable shapes and
elements of other tools are gone.
"""

from collections.abc import Callable, Iterable
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from linked_fleet_agent.urdf.geometry import Box, Capsule, Cylinder, Geometry, MeshShape, Shape, Sphere
from linked_fleet_agent.urdf.inertials import Inertial
from linked_fleet_agent.urdf.joints import Joint, JointKind
from linked_fleet_agent.urdf.limits import ENDLESS_POSITION
from linked_fleet_agent.urdf.model import Link, RobotModel
from linked_fleet_agent.urdf.poses import ORIGIN, Pose, roll_pitch_yaw

Address = Callable[[str], str | None]
"""Returns where the mesh with a URI is found; None leaves out its shape."""


def as_it_is(uri: str) -> str:
    return uri


def plain_element(model: RobotModel, mesh: Address = as_it_is, shapes: bool = True) -> Element:
    """Return the ``robot`` element of a model, with its shapes on request."""
    robot = Element("robot", name=model.name)
    for link in model.links.values():
        _add_link(robot, link, mesh, shapes)
    for joint in model.joints.values():
        _add_joint(robot, joint)
    return robot


def plain_urdf(model: RobotModel, mesh: Address = as_it_is, shapes: bool = True) -> str:
    """Return the text of ``plain_element``."""
    return ElementTree.tostring(plain_element(model, mesh, shapes), encoding="unicode")


def _add_link(robot: Element, link: Link, mesh: Address, shapes: bool) -> None:
    element = SubElement(robot, "link", name=link.name)
    if link.inertial is not None:
        _add_inertial(element, link.inertial)
    for use, found in (("visual", link.visuals), ("collision", link.collisions)) if shapes else ():
        _add_shapes(element, use, found, mesh)


def _add_inertial(link: Element, inertial: Inertial) -> None:
    """Add mass and inertia; an unknown inertia is zero, because other readers need one."""
    inertia = inertial.inertia_kg_m2 or (0.0,) * 6
    element = SubElement(link, "inertial")
    SubElement(element, "origin", xyz=_text(*inertial.centre_m), rpy="0 0 0")
    SubElement(element, "mass", value=_text(inertial.mass_kg))
    moments = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), map(_text, inertia), strict=True)
    SubElement(element, "inertia", dict(moments))


def _add_shapes(link: Element, use: str, shapes: Iterable[Shape], mesh: Address) -> None:
    for shape in shapes:
        form = None if shape.geometry is None else _form(shape.geometry, mesh)
        if form is None:
            continue
        element = SubElement(link, use)
        add_origin(element, shape.origin)
        SubElement(element, "geometry").append(form)
        if shape.colour is not None:
            # Readers take materials of one name as one.
            material = SubElement(element, "material", name=_text(*shape.colour).replace(" ", "_"))
            SubElement(material, "color", rgba=_text(*shape.colour))


def _form(geometry: Geometry, mesh: Address) -> Element | None:
    match geometry:
        case Box(size):
            return Element("box", size=_text(*size))
        case Sphere(radius):
            return Element("sphere", radius=_text(radius))
        case Cylinder(radius, length):
            return Element("cylinder", radius=_text(radius), length=_text(length))
        case Capsule(radius, length):
            return Element("capsule", radius=_text(radius), length=_text(length))
        case MeshShape(uri, scale):
            found = mesh(uri)
            return None if found is None else Element("mesh", filename=found, scale=_text(*scale))


def _add_joint(robot: Element, joint: Joint) -> None:
    element = SubElement(robot, "joint", name=joint.name, type=joint.kind.value)
    add_origin(element, joint.origin)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    if joint.movable or joint.kind is JointKind.PLANAR:
        SubElement(element, "axis", xyz=_text(*joint.axis))
    if joint.movable:
        _add_limit(element, joint)
    known = {"damping": joint.damping, "friction": joint.friction}
    dynamics = {name: _text(value) for name, value in known.items() if value is not None}
    if dynamics:
        SubElement(element, "dynamics", dynamics)
    if joint.mimic is not None:
        multiplier, offset = _text(joint.mimic.multiplier), _text(joint.mimic.offset)
        SubElement(element, "mimic", joint=joint.mimic.joint, multiplier=multiplier, offset=offset)


def _add_limit(element: Element, joint: Joint) -> None:
    """Add the limits: an unknown velocity or effort is zero, an unknown end is further than any robot moves."""
    limits = {"effort": _text(joint.limits.effort or 0.0), "velocity": _text(joint.limits.velocity or 0.0)}
    if joint.kind is not JointKind.CONTINUOUS:
        lower, upper = joint.stops
        limits["lower"] = _text(-ENDLESS_POSITION if lower is None else lower)
        limits["upper"] = _text(ENDLESS_POSITION if upper is None else upper)
    SubElement(element, "limit", limits)


def add_origin(element: Element, pose: Pose) -> None:
    """Add the pose of an element, unless it is the identity."""
    if pose != ORIGIN:
        xyz, rpy = _text(*pose.position_m), _text(*roll_pitch_yaw(pose.orientation_xyzw))
        SubElement(element, "origin", xyz=xyz, rpy=rpy)


def _text(*values: float) -> str:
    return " ".join(repr(value + 0.0).removesuffix(".0") for value in values)  # + 0.0 turns -0.0 into 0.0
