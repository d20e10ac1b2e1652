"""Contacts of robots with objects, what they hold and each other, in one model of MuJoCo."""

import math

import numpy as np
import pytest

from linked_fleet_agent.robots.contact_model import Contact, ContactModel, ContactObject, ContactRobot, Grip
from linked_fleet_agent.robots.convex_pieces import convex_pieces
from linked_fleet_agent.urdf.geometry import Box, Cylinder, Sphere
from linked_fleet_agent.urdf.poses import ORIGIN, Pose

ARM = """<robot name="arm"><link name="root"/>
<link name="upper"><collision><origin xyz=".25 0 0"/><geometry><box size=".5 .1 .1"/></geometry></collision></link>
<link name="hand"><collision><origin xyz=".1 0 0"/><geometry>{hand}</geometry></collision></link>
<joint name="shoulder" type="revolute"><parent link="root"/><child link="upper"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="wrist" type="revolute"><parent link="upper"/><child link="hand"/><origin xyz=".5 0 0"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"""
BOX = '<box size=".2 .1 .1"/>'
CORNERS = np.array(list(np.ndindex(2, 2, 2)), dtype=float)
FACES = ((0, 1, 3), (0, 3, 2), (4, 7, 5), (4, 6, 7), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
         (1, 5, 7), (1, 7, 3))  # fmt: skip


def box(size: tuple[float, float, float], at: tuple[float, float, float]) -> np.ndarray:
    return (CORNERS - 0.5) * size + at


def joined(*boxes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    faces = np.concatenate([np.array(FACES) + 8 * k for k in range(len(boxes))])
    return np.concatenate(boxes), faces


TABLE = joined(
    box((1, 1, 0.1), (0, 0, 0.5)), box((0.1, 0.1, 0.45), (0.4, 0, 0.225)), box((0.1, 0.1, 0.45), (-0.4, 0, 0.225))
)
"""A surface of three boxes that touch nowhere by a corner."""


def arm(name: str = "arm", hand: str = BOX, grips: tuple[str, ...] = ()) -> ContactRobot:
    return ContactRobot.made(name, ARM.format(hand=hand), ("shoulder", "wrist"), lambda uri: TABLE, grips)


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose((x, y, z), ORIGIN.orientation_xyzw)


def thing(pose: Pose, geometry: object = Box((0.2, 0.2, 0.2)), **more: object) -> ContactObject:
    return ContactObject("thing", geometry, pose, title="crate", **more)  # type: ignore[arg-type]


def touched(model: ContactModel) -> list[str]:
    return [each.what for each in model.contacts()]


@pytest.mark.parametrize("geometry", [Box((0.2, 0.2, 0.2)), Sphere(0.1), Cylinder(0.1, 0.2)])
def test_an_arm_touches_what_it_turns_into(geometry: object) -> None:
    model = ContactModel([arm()], [thing(at(0.0, 0.3), geometry)])
    assert touched(model) == []
    model.place("arm", ORIGIN, (math.pi / 2, 0.0))
    assert touched(model) == ["upper of arm touches crate"]
    model.place("arm", at(2.0, 0.0), (math.pi / 2, 0.0))
    assert touched(model) == []
    model.place("arm", at(2.0, 0.0), (math.nan, 0.0), base=at(-2.0, 0.0))
    assert touched(model) == ["upper of arm touches crate"], "an unknown position stays as it was"


def test_shapes_that_graze_each_other_do_not_touch() -> None:
    assert touched(ContactModel([arm()], [thing(at(0.2, 0.147))])) == []
    assert touched(ContactModel([arm()], [thing(at(0.2, 0.143))])) == ["upper of arm touches crate"]


def test_a_hand_may_touch_objects() -> None:
    crate = thing(at(0.65, 0.1))
    assert touched(ContactModel([arm()], [crate])) == ["hand of arm touches crate"]
    assert touched(ContactModel([arm(grips=("hand",))], [crate])) == []


def test_what_a_robot_holds_touches_others_and_never_the_robot() -> None:
    held = ContactObject("bar", Box((0.9, 0.05, 0.05)), at(0.2, 0.0), Grip("arm", "hand"), "bar")
    model = ContactModel([arm()], [held, thing(at(1.0, 0.0))])
    assert touched(model) == ["bar, which arm holds, touches crate"]
    model.place("arm", ORIGIN, (math.pi / 2, 0.0))
    assert touched(model) == []


def test_robots_touch_each_other() -> None:
    model = ContactModel([arm("one"), arm("two")], [])
    model.place("two", at(1.3, 0.0), (math.pi, 0.0))
    assert {(each.robot, each.other, each.what) for each in model.contacts()} == {
        ("one", "two", "hand of one touches hand of two"),
        ("two", "one", "hand of two touches hand of one"),
    }


def test_a_hollow_between_parts_of_a_mesh_is_free() -> None:
    def under(height_m: float) -> list[Contact]:
        table = thing(at(0.5, 0.0), TABLE)
        model = ContactModel([arm()], [table])
        model.place("arm", at(0.3, -0.5, height_m), (math.pi / 2, 0.0))
        return model.contacts()

    assert under(0.25) == [], "between the legs"
    assert [each.other for each in under(0.45)] == ["thing"], "in the top"


def test_a_mesh_that_cannot_be_used_is_named() -> None:
    made = ContactRobot.made(
        "arm", ARM.format(hand='<mesh filename="a.stl"/>'), ("shoulder", "wrist"), lambda uri: None
    )
    assert made.unused == ("hand",) and made.pieces == ()
    assert len(arm(hand='<mesh filename="a.stl"/>').pieces) == 3


def test_a_part_that_is_not_convex_is_cut() -> None:
    """A bent bar: two boxes that share corners. Pieces of it are shorter than the hollow is wide."""
    vertices, triangles = joined(box((1, 0.1, 0.1), (0.5, 0, 0)), box((0.1, 1, 0.1), (0.05, 0.55, 0)))
    pieces = convex_pieces(np.concatenate([vertices, vertices[:1]]), triangles)
    assert len(pieces) >= 2
    assert all((np.ptp(each, axis=0) > 0).all() for each in pieces)
    assert not any(
        (each.min(axis=0) < (0.4, 0.4, 0)).all() and (each.max(axis=0) > (0.5, 0.5, 0)).all() for each in pieces
    )


def test_a_flat_surface_has_a_thickness() -> None:
    flat = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=float)
    triangles = np.array([(0, 1, 2), (0, 2, 3)])
    (piece,) = convex_pieces(flat, triangles)
    assert 0 < np.ptp(piece[:, 2]) < 0.005
    (found,) = ContactModel([arm()], [thing(at(0.3, -0.5), (flat, triangles))]).contacts()
    assert found.other == "thing"
