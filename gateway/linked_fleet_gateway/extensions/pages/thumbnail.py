"""A small SVG drawing of a robot in its present pose, from forward kinematics, without meshes or WebGL.

Each link is a stroke from its frame through its centre of mass to its child joints. Its width is that of a ball of the
same mass with ``_DENSITY_KG_M3``: apart from meshes, which the gateway does not have, a URDF contains no other size.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from linked_fleet_state.kinematics import compose
from linked_fleet_state.model import Link, Pose, RobotModel
from linked_fleet_state.robot import Robot
from linked_fleet_state.xml import Vector

SVG = "image/svg+xml"
WIDTH, HEIGHT = 160, 120
_MARGIN = 8.0
_DENSITY_KG_M3 = 1800.0
_THINNEST, _WIDEST = 0.012, 0.1  # widths of strokes, as shares of the larger side of the robot
_JOINT = 0.013
# The camera looks from the front, the right and above, as that of the scene (scripts/src/scene_view.js).
_FROM = (1.0, -0.75, 0.5)
_FAR, _NEAR = (96, 112, 132), (176, 190, 208)
_MARK = "#f08a24"
_NO_ROTATION = (0.0, 0.0, 0.0, 1.0)
Point = tuple[float, float]


@dataclass(frozen=True)
class Stroke:
    """A line between two points of the world in m, ``width_m`` wide."""

    start: Vector
    end: Vector
    width_m: float


def drawing(robot: Robot) -> bytes:
    """Draw the robot in its latest frame; without a frame, draw a question mark."""
    model = robot.model
    strokes = [] if model is None else list(_strokes(robot, model))
    if model is None or not strokes:
        return _document('<text x="80" y="72" text-anchor="middle" font-size="36" fill="#8a96a6">?</text>')
    joints = [pose.position_m for pose in _joints(robot, model)]
    return _document(_draw(strokes, joints))


def _strokes(robot: Robot, model: RobotModel) -> Iterator[Stroke]:
    bodies = _bodies(model)
    for name in bodies:
        pose, link = robot.link_pose(name), model.links[name]
        if pose is None:
            continue
        below = [model.joints[joint].child for joint in link.child_joints]
        ends = [end for each in below if each in bodies and (end := robot.link_pose(each)) is not None]
        yield from _body(link, pose, [end.position_m for end in ends])


def _bodies(model: RobotModel) -> Collection[str]:
    """Return the links that have a mass or lead to one; the others are mere frames. All links if none has a mass."""
    found: dict[str, None] = {}
    for link in model.links.values():
        name: str | None = link.name if link.inertial is not None else None
        while name is not None and name not in found:
            found[name] = None
            joint = model.links[name].parent_joint
            name = None if joint is None else model.joints[joint].parent
    return found or model.links


def _body(link: Link, pose: Pose, ends: Sequence[Vector]) -> Iterator[Stroke]:
    inertial = link.inertial
    if inertial is None or inertial.mass_kg <= 0:
        yield from (Stroke(pose.position_m, end, 0.0) for end in ends)
        return
    middle = compose(pose, Pose(inertial.centre_m, _NO_ROTATION)).position_m
    width_m = 2 * (3 * inertial.mass_kg / (4 * math.pi * _DENSITY_KG_M3)) ** (1 / 3)
    yield from (Stroke(middle, end, width_m) for end in (pose.position_m, *ends))


def _joints(robot: Robot, model: RobotModel) -> Iterator[Pose]:
    for joint in model.joints.values():
        pose = robot.link_pose(joint.child)
        if joint.movable and pose is not None:
            yield pose


# -- on paper -------------------------------------------------------------------------------------------------------


def _axes() -> tuple[Vector, Vector, Vector]:
    """Return the directions to the right and upwards on the drawing, and towards the eye."""
    x, y, z = (each / math.hypot(*_FROM) for each in _FROM)
    across = math.hypot(x, y)
    right = (-y / across, x / across, 0.0)
    return right, (-z * right[1], z * right[0], x * right[1] - y * right[0]), (x, y, z)


_RIGHT, _UP, _EYE = _axes()


def _draw(strokes: Sequence[Stroke], joints: Sequence[Vector]) -> str:
    points = [point for each in strokes for point in (each.start, each.end)]
    across, up, near = ([_dot(axis, point) for point in points] for axis in (_RIGHT, _UP, _EYE))
    size = max(max(across) - min(across), max(up) - min(up), 0.05)
    widest = min(max((each.width_m for each in strokes), default=0.0), _WIDEST * size)
    left, low = min(across) - widest / 2, min(up) - widest / 2
    wide, high = max(across) - left + widest / 2, max(up) - low + widest / 2
    scale = min((WIDTH - 2 * _MARGIN) / wide, (HEIGHT - 2 * _MARGIN) / high)
    before, after = (WIDTH - wide * scale) / 2, (HEIGHT - high * scale) / 2

    def place(point: Vector) -> Point:
        return before + (_dot(_RIGHT, point) - left) * scale, HEIGHT - after - (_dot(_UP, point) - low) * scale

    drawn = []
    depth = max(near) - min(near) or 1.0
    for each in sorted(strokes, key=_nearness):
        (a, b), (c, d) = place(each.start), place(each.end)
        width = scale * min(max(each.width_m, _THINNEST * size), _WIDEST * size)
        shade = _shade((_nearness(each) - min(near)) / depth)
        drawn.append(f'<path d="M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" stroke="{shade}" stroke-width="{width:.1f}"/>')
    radius = scale * _JOINT * size
    dots = "".join(f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{radius:.1f}"/>' for a, b in map(place, joints))
    return f'<g stroke-linecap="round">{"".join(drawn)}</g><g fill="{_MARK}">{dots}</g>'


def _nearness(stroke: Stroke) -> float:
    """Return the distance of the stroke's middle towards the eye, in m."""
    return (_dot(_EYE, stroke.start) + _dot(_EYE, stroke.end)) / 2


def _shade(share: float) -> str:
    return "#" + "".join(f"{round(far + (near - far) * share):02x}" for far, near in zip(_FAR, _NEAR, strict=True))


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _document(content: str) -> bytes:
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}">'
    return f"{head}{content}</svg>\n".encode()
