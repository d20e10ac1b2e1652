"""Meshes as collision shapes: convex hulls, interiors, and concave links."""

import math
import struct

import numpy as np
import pytest

from linked_fleet_gateway.extensions.world import surfaces
from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CollisionFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
)
from linked_fleet_gateway.extensions.world.shapes import build_robot
from linked_fleet_gateway.extensions.world.surfaces import read_mesh, winding_number
from linked_fleet_state.model import Pose
from linked_fleet_state.xml import ModelError
from meshes import BOX, channel, plate, read, stl

HERE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def test_a_closed_mesh_that_fills_its_hull_is_its_hull() -> None:
    assert read(BOX).fills_hull
    assert not read(channel()).fills_hull
    assert not read(BOX[:-1]).fills_hull  # a triangle of its surface is missing
    assert not read(plate(1.0)).fills_hull


def test_a_point_within_a_closed_mesh_is_inside() -> None:
    surface = read(channel())
    assert abs(winding_number(surface, np.array([0.0, -0.075, 0.0]))) == pytest.approx(1.0)
    assert winding_number(surface, np.array([0.0, 0.05, 0.0])) == pytest.approx(0.0, abs=1e-9)


def test_a_mesh_of_too_many_triangles_counts_as_its_hull(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surfaces, "MOST_TRIANGLES", 8)
    surface = read(channel())
    assert surface.fills_hull and winding_number(surface, np.array([0.0, 0.05, 0.0])) != 0


@pytest.mark.parametrize("content", [b"", b"solid", stl([]), stl([((0, 0, 0),) * 3]), stl(BOX)[:200]])
def test_an_invalid_mesh_is_refused(content: bytes) -> None:
    with pytest.raises(ModelError):
        read_mesh("stl", content)


@pytest.mark.parametrize("value", [math.nan, math.inf, 3e38])
def test_a_mesh_with_a_vertex_that_is_nowhere_is_refused(value: float) -> None:
    broken = bytearray(stl(BOX))
    broken[84 + 12 : 84 + 16] = struct.pack("<f", value)
    with pytest.raises(ModelError):
        read_mesh("stl", bytes(broken))


# -- links ----------------------------------------------------------------------------------------------------

# A channel that is open at its top, and a rod on a slide that descends into it and is rotated there.
_CHANNEL = "channel.stl"
_LIFT = f"""<robot name='lift'>
  <link name='foot'><collision><geometry><mesh filename='{_CHANNEL}'/></geometry></collision></link>
  <link name='stage'/><link name='carriage'/>
  <link name='rod'><collision><geometry><box size='.3 .02 .02'/></geometry></collision></link>
  <joint name='turn' type='continuous'><parent link='foot'/><child link='stage'/><axis xyz='0 1 0'/></joint>
  <joint name='lift' type='prismatic'><parent link='stage'/><child link='carriage'/>
    <axis xyz='0 1 0'/><limit lower='-1' upper='1' velocity='1' effort='1'/></joint>
  <joint name='spin' type='continuous'><parent link='carriage'/><child link='rod'/><axis xyz='0 1 0'/></joint>
</robot>"""


def _go(start: dict[str, float], ends: dict[str, float]) -> Answer:
    robot = build_robot(_LIFT, {_CHANNEL}, lambda uri: read(channel()))
    way = MotionPath({"turn": 0.0, "spin": 0.0} | start, (PathSegment(ends),))
    return check(Check(Placement("me", "lift", HERE), (way,), (), (), 30.0), {"lift": robot}, {})


@pytest.mark.parametrize("scale", ["1e300 1 1", "1e308 1e308 1e308", "1e7 1e7 1e7", "0 0 0", "1 0 1"])
def test_a_shape_without_a_size_that_can_be_reckoned_with_is_not_used(scale: str) -> None:
    """Comparisons with NaN would consider nothing near it."""
    robot = build_robot(_LIFT.replace("<mesh ", f"<mesh scale='{scale}' "), {_CHANNEL}, lambda uri: read(channel()))
    assert [each.link for each in robot.unchecked] == ["foot"]


def test_a_part_goes_where_the_concave_link_is_not_and_its_hull_is() -> None:
    assert isinstance(_go({"lift": 0.3}, {"lift": 0.0}), Free)
    met = _go({"lift": 0.3}, {"lift": -0.1})
    assert isinstance(met, CollisionFound) and {met.link, met.other} == {"rod", "foot"}


def test_a_body_inside_a_mesh_collides_with_its_surface() -> None:
    met = _go({"lift": 0.0}, {"spin": 1.57})
    assert isinstance(met, CollisionFound) and 0.1 < met.share < 0.5


def test_a_part_inside_of_another_is_not_free_to_leave_through_its_surface_unless_it_was_there() -> None:
    """It begins inside the bottom of the channel, where it touches no triangle: such pairs are not compared."""
    assert isinstance(_go({"lift": -0.075}, {"lift": 0.3}), Free)
