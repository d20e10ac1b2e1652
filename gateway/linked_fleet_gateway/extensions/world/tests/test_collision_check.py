"""A robot of simple shapes on its path among others, as judged by the process that checks motions."""

import math
import struct
from itertools import product

import numpy as np
import pytest
from msgspec.structs import replace

from linked_fleet_gateway.extensions.world.collision_check import MARGIN_M, check
from linked_fleet_gateway.extensions.world.messages import (
    Check,
    CheckFailed,
    CollisionFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
)
from linked_fleet_gateway.extensions.world.scene import Box, Geometry, Sphere, TriangleMesh, read_stl
from linked_fleet_gateway.extensions.world.shapes import build_object_shape, build_robot
from linked_fleet_gateway.extensions.world.surfaces import Array, Surface
from linked_fleet_state.model import Pose

UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def link(name: str, size: str, x: float, z: float = 0.0) -> str:
    shape = f'<collision><origin xyz="{x} 0 {z}"/><geometry><box size="{size}"/></geometry></collision>'
    return f'<link name="{name}">{shape}</link>'


def turning(name: str, parent: str, child: str, x: float = 0.0, more: str = "") -> str:
    return (
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>{more}</joint>'
    )


# A rod of 1 m that sweeps over a small foot; and one of four parts of 25 cm that can hit its own foot.
FOOT, ARM = link("foot", ".1 .1 .1", 0), link("arm", "1 .02 .02", 0.5)
ROD = f"<robot name='rod'>{FOOT}{ARM}{turning('turn', 'foot', 'arm')}</robot>"
PARTS = "".join(link(f"part{i}", ".2 .02 .02", 0.125) for i in range(4))
JOINTS = "".join(turning(f"j{i}", f"part{i}", f"part{i + 1}", 0.25) for i in range(3))
CHAIN = f"<robot name='chain'>{PARTS}{JOINTS}</robot>"
MIMIC = "<mimic joint='turn' multiplier='-1'/>"
PAIR = (
    f"<robot name='pair'><link name='foot'/>{link('left', '.5 .02 .02', 0.25)}{link('right', '.5 .02 .02', 0.25, 0.3)}"
    f"{turning('turn', 'foot', 'left')}{turning('follow', 'foot', 'right', more=MIMIC)}</robot>"
)
ROBOTS = {name: build_robot(urdf) for name, urdf in (("rod", ROD), ("chain", CHAIN), ("pair", PAIR))}


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose((x, y, z), UPRIGHT)


HERE = at(0, 0)


def go(
    ends: dict[str, float],
    *things: tuple[Geometry, Pose],
    robot: str = "rod",
    start: dict[str, float] | None = None,
    others: tuple[Placement, ...] = (),
    base: Pose = HERE,
) -> object:
    named = {f"thing{i}": build_object_shape(geometry) for i, (geometry, _) in enumerate(things)}
    objects = tuple(Placement(name, name, pose) for name, (_, pose) in zip(named, things, strict=True))
    from_zero = dict.fromkeys((n for n in ROBOTS[robot].model.names if n != "universe"), 0.0)
    way = MotionPath(from_zero | (start or {}), (PathSegment(ends),))
    return check(Check(Placement("me", robot, base), (way,), others, objects, 30.0), ROBOTS, named)


def test_a_free_way_is_free() -> None:
    assert isinstance(go({"turn": math.pi}, (Sphere(0.1), at(0, -0.5))), Free)


@pytest.mark.parametrize("degrees", [30, 90, 150])
def test_a_collision_has_its_place_on_the_path(degrees: int) -> None:
    where = math.radians(degrees)
    met = go({"turn": math.pi}, (Sphere(0.05), at(0.8 * math.cos(where), 0.8 * math.sin(where))))
    assert isinstance(met, CollisionFound)
    assert (met.link, met.kind, met.name) == ("arm", "object", "thing0")
    # The ball, half of the rod and the margin come before its middle.
    touching = where - (0.05 + 0.01 + MARGIN_M) / 0.8
    assert met.share * math.pi == pytest.approx(touching, abs=2 * MARGIN_M)


@pytest.mark.parametrize(
    "base", [Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), Pose((2.0, 3.0, 0.0), (0.0, 0.0, 1.0, 0.0))]
)
def test_the_point_where_it_would_meet_something_is_in_the_world(base: Pose) -> None:
    sign = -1.0 if base.orientation_xyzw[2] else 1.0
    x, y = base.position_m[0], base.position_m[1] + sign * 0.8
    met = go({"turn": math.pi}, (Sphere(0.05), at(x, y)), base=base)
    assert isinstance(met, CollisionFound) and met.point is not None
    assert math.dist(met.point, (x, y, 0.0)) == pytest.approx(0.05, abs=MARGIN_M)


def test_nothing_is_so_thin_that_it_is_passed_by() -> None:
    for i in range(40):
        where = 0.3 + i * 0.03
        thread = Sphere(1e-4), at(0.99 * math.cos(where), 0.99 * math.sin(where))
        assert isinstance(go({"turn": math.pi}, thread), CollisionFound), where


def test_a_mesh_is_a_surface_and_one_may_reach_under_it() -> None:
    flat = _plate(0.5)
    assert isinstance(go({"turn": 1.0}, (flat, at(0.5, 0.8, 0.2))), Free)
    assert isinstance(go({"turn": 1.0}, (flat, at(0.5, 0.8, 0.0))), CollisionFound)


def _plate(half: float) -> TriangleMesh:
    corners = [(-half, -half, 0.0), (half, -half, 0.0), (half, half, 0.0), (-half, half, 0.0)]
    faces = [[corners[i] for i in face] for face in ((0, 1, 2), (0, 2, 3))]
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *(x for corner in face for x in corner), 0) for face in faces)
    return read_stl(b"\0" * 80 + struct.pack("<I", len(faces)) + body)


def test_out_of_a_zone_and_not_further_in() -> None:
    zone = Box((1.0, 0.4, 0.5)), at(0.6, -0.15)  # the rod is 5 cm inside
    assert isinstance(go({"turn": 0.8}, zone), Free)
    met = go({"turn": -0.2}, zone)
    assert isinstance(met, CollisionFound) and met.share < 0.1


def test_bodies_that_are_close_at_the_start_may_stay_close() -> None:
    table = Box((2.0, 2.0, 0.1)), at(0, 0, -0.065)  # 5 mm below the rod, all along its path; the foot stands in it
    assert isinstance(go({"turn": 2.0}, table), Free)


def test_another_robot_in_each_of_its_stances() -> None:
    base = Pose((1.5, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))  # it points at the first one, from beyond its reach
    away = Placement("you", "rod", base, ({"turn": math.pi},))
    assert isinstance(go({"turn": 1.0}, others=(away,)), Free)
    pointing = Placement("you", "rod", base, ({"turn": math.pi}, {"turn": -0.3}))
    met = go({"turn": 1.0}, others=(pointing,))
    assert isinstance(met, CollisionFound) and (met.link, met.kind, met.name, met.other) == (
        "arm",
        "robot",
        "you",
        "arm",
    )


def test_a_robot_that_is_out_of_reach_need_not_be_known() -> None:
    assert isinstance(go({"turn": 1.0}, others=(Placement("far", "rod", at(5, 0), ({},)),)), Free)
    unknown = go({"turn": 1.0}, others=(Placement("near", "rod", at(1.5, 0), ({},)),))
    assert unknown == CheckFailed("of near it is unknown where joint turn is")


def test_links_with_several_joints_between_them_collide() -> None:
    met = go({f"j{i}": 2.1 for i in range(3)}, robot="chain")
    assert isinstance(met, CollisionFound) and (met.kind, {met.link, met.other}) == ("self", {"part0", "part3"})
    met = go({"j1": 2.2, "j2": 2.2}, robot="chain")
    assert isinstance(met, CollisionFound) and (met.kind, {met.link, met.other}) == ("self", {"part1", "part3"})
    assert isinstance(go({"j1": 3.0}, robot="chain"), Free)  # adjacent parts are not compared


def test_no_part_of_its_own_is_so_thin_that_it_is_passed_by() -> None:
    """A rod that rotates above a foot with a blade 0.1 mm thick, at any angle."""
    for i in range(20):
        degrees = 20 + 3.1 * i
        met = check(_own(f"blade{i}"), {f"blade{i}": build_robot(_blade(degrees))}, {})
        assert isinstance(met, CollisionFound) and (met.kind, {met.link, met.other}) == ("self", {"foot", "arm"}), (
            degrees
        )


def _blade(degrees: float) -> str:
    where = math.radians(degrees)
    place = f'<origin xyz="{math.cos(where)} {math.sin(where)} 0.1" rpy="0 0 {where}"/>'
    foot = f'<link name="foot"><collision>{place}<geometry><box size=".1 .0001 .1"/></geometry></collision></link>'
    arm = link("arm", "1 .0001 .01", 0.5, 0.1)
    joints = turning("turn", "foot", "mast") + turning("nod", "mast", "arm", 0.05)
    return f"<robot name='blade'>{foot}<link name='mast'/>{arm}{joints}</robot>"


def _own(key: str, turn: float = math.pi / 2) -> Check:
    way = MotionPath({"turn": 0.0, "nod": 0.0}, (PathSegment({"turn": turn}),))
    return Check(Placement("me", key, HERE), (way,), (), (), 30.0)


def test_parts_that_are_near_from_the_start_may_stay_so() -> None:
    """Half a millimetre between foot and arm, while rotating."""
    foot = '<link name="foot"><collision><geometry><cylinder radius=".2" length=".1"/></geometry></collision></link>'
    arm = link("arm", ".3 .02 .02", 0.1, 0.0605)
    joints = turning("turn", "foot", "mast") + turning("nod", "mast", "arm", 0.05)
    robot = build_robot(f"<robot name='near'>{foot}<link name='mast'/>{arm}{joints}</robot>")
    assert robot.pairs and isinstance(check(_own("near"), {"near": robot}, {}), Free)


@pytest.mark.parametrize("gap_m", [5e-4, 5e-6, 5e-8])
def test_parts_that_are_near_from_the_start_may_part_and_not_touch(gap_m: float) -> None:
    """A rod beside a post of its own foot."""
    post = f'<origin xyz="0.5 {0.02 + gap_m} 0"/><geometry><box size=".02 .02 .02"/></geometry>'
    foot = f'<link name="foot"><collision>{post}</collision></link>'
    joints = turning("turn", "foot", "mast") + turning("nod", "mast", "arm", 0.05)
    robots = {
        "post": build_robot(
            f"<robot name='post'>{foot}<link name='mast'/>{link('arm', '1 .02 .02', 0.5)}{joints}</robot>"
        )
    }
    met = check(_own("post", 0.2), robots, {})
    assert isinstance(met, CollisionFound) and (met.kind, {met.link, met.other}) == ("self", {"foot", "arm"})
    assert isinstance(check(_own("post", -0.2), robots, {}), Free)


def test_parts_that_are_near_from_the_start_do_not_pass_through_each_other() -> None:
    """A foot with two blades without thickness: the equally thin rod starts 0.5 mm beside one of them."""
    arm = link("arm", "1 .0001 .01", 0.5, 0.1)
    joints = turning("turn", "foot", "mast") + turning("nod", "mast", "arm", 0.05)
    foot = '<link name="foot"><collision><geometry><mesh filename="blades"/></geometry></collision></link>'
    urdf = f"<robot name='blades'>{foot}<link name='mast'/>{arm}{joints}</robot>"
    for i in range(20):
        degrees = 20 + 3.1 * i
        blades = np.concatenate([_standing(1.0, -0.00055, degrees=0.0), _standing(1.0, 0.0, degrees)])
        surface = Surface.from_triangles(blades, np.arange(6).reshape(-1, 3))
        robots = {"blades": build_robot(urdf, {"blades"}, lambda uri, surface=surface: surface)}
        met = check(_own("blades"), robots, {})
        assert isinstance(met, CollisionFound) and met.kind == "self", degrees
        assert met.share * 90 == pytest.approx(degrees, abs=1.0)


def _standing(x: float, y: float, degrees: float) -> Array:
    """Return a triangle of 10 cm by 10 cm that stands along the rod after so much rotation."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    corners = [(x - 0.05, y, 0.05), (x + 0.05, y, 0.05), (x, y, 0.15)]
    return np.array([(cos * a - sin * b, sin * a + cos * b, c) for a, b, c in corners])


def test_a_surface_that_is_near_from_the_start_does_not_go_into_a_mesh() -> None:
    """The rod as a mesh without its ends, 0.5 mm beside a vertical plate."""
    turned = [(x, y, z) for x in (0.1, 0.9) for y, z in ((-0.01, -0.01), (0.01, -0.01), (0.01, 0.01), (-0.01, 0.01))]
    sides = [(i, (i + 1) % 4) for i in range(4)]
    triangles = np.array([each for i, j in sides for each in ((i, j, j + 4), (i, j + 4, i + 4))])
    surface = Surface.from_triangles(np.array(turned), triangles)
    arm = '<link name="arm"><collision><geometry><mesh filename="rod"/></geometry></collision></link>'
    robots = {
        "mesh": build_robot(
            f"<robot name='mesh'>{FOOT}{arm}{turning('turn', 'foot', 'arm')}</robot>", {"rod"}, lambda uri: surface
        )
    }
    standing = Pose((0.5, 0.0105, 0.0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    asked = Check(Placement("me", "mesh", HERE), (), (), (Placement("plate", "plate", standing),), 30.0)
    plates = {"plate": build_object_shape(_plate(0.2))}
    answers = [
        check(replace(asked, paths=(MotionPath({"turn": 0.0}, (PathSegment({"turn": end}),)),)), robots, plates)
        for end in (0.3, -0.3)
    ]
    assert isinstance(answers[0], CollisionFound) and answers[0].name == "plate"
    assert isinstance(answers[1], Free)


def test_a_robot_that_has_to_be_prepared_again_is_not_free() -> None:
    assert isinstance(check(_own("nobody"), ROBOTS, {}), CheckFailed)


def test_mimicking_joints_move_in_the_check() -> None:
    ball = Sphere(0.05), at(0.4 * math.cos(0.5), -0.4 * math.sin(0.5), 0.3)
    met = go({"turn": 1.0}, ball, robot="pair")
    assert isinstance(met, CollisionFound) and met.link == "right"


def test_the_placement_of_the_robot_is_considered() -> None:
    quarter = Pose((2.0, 1.0, 0.0), (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)))
    ball = (Sphere(0.05), at(2.0 - 0.8 * math.sin(0.5), 1.0 + 0.8 * math.cos(0.5)))
    assert isinstance(go({"turn": 1.0}, ball, base=quarter), CollisionFound)
    assert isinstance(go({"turn": -1.0}, ball, base=quarter), Free)


def test_a_check_beyond_its_time_limit_is_not_free() -> None:
    assert isinstance(go({"turn": 1e4}, (Sphere(0.1), at(0.5, 0, 0.2))), CheckFailed)


def test_positions_of_no_size_at_all_make_no_difference() -> None:
    for x, y in product((0.0, 1e-300), repeat=2):
        assert isinstance(go({"turn": x}, start={"turn": y}), Free)
