"""Robots that drive, as the check of motions sees them: on three more joints, which are zero where the base is now."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement, tostring

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.world.messages import DrivenWay, MotionPath, PathSegment, Positions
from linked_fleet_gateway.extensions.world.other_motions import paths_along
from linked_fleet_state.model import RobotModel
from linked_fleet_state.xml import parse_xml

PLANE = ("plane x", "plane y", "plane turn")
"""Names of the joints by which a base slides and turns: metre, metre, radian."""
AT_REST: Positions = dict.fromkeys(PLANE, 0.0)
_LINKS = ("floor", "floor x", "floor y")


def on_plane(urdf: str) -> str:
    """Return the description of a robot whose root slides over a plane and turns. Raises ModelError."""
    document, root = parse_xml(urdf), RobotModel.parse(urdf).root
    for name in _LINKS:
        SubElement(document, "link", name=name)
    x, y, turn = PLANE
    _join(document, x, "prismatic", "1 0 0", *_LINKS[:2])
    _join(document, y, "prismatic", "0 1 0", *_LINKS[1:])
    _join(document, turn, "continuous", "0 0 1", _LINKS[2], root)
    return tostring(document, encoding="unicode")


def _join(document: Element, name: str, kind: str, axis: str, parent: str, child: str) -> None:
    joint = SubElement(document, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "axis", xyz=axis)
    if kind == "prismatic":  # how far it slides is up to the path
        SubElement(joint, "limit", lower="-0.001", upper="0.001", velocity="1", effort="1")


def positions_of(pose: Pose) -> Positions:
    """Return the positions of the joints of the plane at a pose in the frame of the base as it is now."""
    return dict(zip(PLANE, pose, strict=True))


def legs_of(way: tuple[Pose, ...]) -> tuple[PathSegment, ...]:
    return tuple(PathSegment(positions_of(pose)) for pose in way)


def driven_paths(driven: DrivenWay) -> Iterator[MotionPath]:
    """Yield the paths of the joints of the plane, and of others that move meanwhile."""
    for way in driven.drive.ways(driven.now, driven.before):
        yield from paths_along(legs_of(way), driven.start, driven.elsewhere)
