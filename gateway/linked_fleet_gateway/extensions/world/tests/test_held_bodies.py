"""Objects that robots hold, and objects that hands may touch, as judged by the process that checks motions."""

import math
import struct
from itertools import pairwise

import pytest

from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CheckFailed,
    CollisionFound,
    Free,
    HeldObject,
    MotionPath,
    PathSegment,
    Placement,
)
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, Geometry, Sphere, TriangleMesh, read_stl
from linked_fleet_gateway.extensions.world.shapes import build_object_shape, build_robot, build_unchecked_robot
from linked_fleet_state.model import Pose

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LINKS, LENGTH_M = ("base", "upper", "lower", "hand"), 0.4


def link(name: str) -> str:
    shape = f'<origin xyz="{LENGTH_M / 2} 0 0"/><geometry><box size=".3 .04 .04"/></geometry>'
    return f'<link name="{name}"><collision>{shape}</collision></link>'


def joint(name: str, parent: str, child: str) -> str:
    return (
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{0.0 if parent == "base" else LENGTH_M} 0 0"/><axis xyz="0 0 1"/></joint>'
    )


JOINTS = ("shoulder", "elbow", "wrist")
URDF = (
    "<robot name='arm'><link name='base'/>"
    + "".join(map(link, LINKS[1:]))
    + "".join(joint(name, *ends) for name, ends in zip(JOINTS, pairwise(LINKS), strict=True))
    + "</robot>"
)
ROBOTS = {"arm": build_robot(URDF), "unseen": build_unchecked_robot(URDF, "no meshes")}
STRETCHED = dict.fromkeys(JOINTS, 0.0)
"""Along x; the hand ends 1.2 m from the root."""
BAR = Box((0.6, 0.04, 0.04))
TIP = Pose((0.7, 0.0, 0.0), UPRIGHT)
"""Where the hand holds a bar: it reaches 1.8 m from the root."""
TURNED = Pose((0.4, 0.0, 0.0), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))
"""A bar across the hand."""


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose((x, y, z), UPRIGHT)


def held(pose: Pose = TIP, key: str = "bar") -> HeldObject:
    return HeldObject("bar", key, "hand", pose, ("lower", "hand"))


def asked(
    ends: dict[str, float], *objects: Placement, holds: tuple[HeldObject, ...] = (), others: tuple[Placement, ...] = ()
) -> Check:
    way = MotionPath(STRETCHED, (PathSegment(ends),))
    return Check(Placement("me", "arm", at(0, 0), holds=holds), (way,), others, objects, 30.0)


def answer(question: Check, **shapes: Geometry) -> Answer:
    known = {"bar": BAR, **shapes}
    return check(question, ROBOTS, {name: build_object_shape(each) for name, each in known.items()})


def thing(name: str, pose: Pose) -> Placement:
    return Placement(name, name, pose)


def plate() -> TriangleMesh:
    """Return a closed box of triangles: 60 cm along x."""
    x, y, z = 0.3, 0.02, 0.02
    corners = [(a * x, b * y, c * z) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(q[0], *pair) for q in quads for pair in ((q[1], q[2]), (q[2], q[3]))]
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *(n for i in face for n in corners[i]), 0) for face in faces)
    return read_stl(b"\0" * 80 + struct.pack("<I", len(faces)) + body)


POST = Cylinder(0.05, 1.0)


@pytest.mark.parametrize("form", [BAR, Cylinder(0.02, 0.6), Sphere(0.3), plate()], ids=lambda each: type(each).__name__)
def test_what_is_held_meets_what_the_arm_alone_would_not(form: Geometry) -> None:
    lying = Pose((0.7, 0.0, 0.0), (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))) if isinstance(form, Cylinder) else TIP
    post = thing("post", at(0.0, 1.6))
    assert isinstance(answer(asked({"shoulder": math.pi}, post), post=POST), Free)
    met = answer(asked({"shoulder": math.pi}, post, holds=(held(lying, "form"),)), post=POST, form=form)
    assert isinstance(met, CollisionFound), met
    assert (met.link, met.held, met.kind, met.name, met.other_held) == ("hand", "bar", "object", "post", "")
    assert 0.3 < met.share < 0.5


def test_what_is_held_may_touch_its_hand_and_no_other_part() -> None:
    """The bar across the hand passes the hand and the lower arm, and meets the upper arm."""
    folded = {"elbow": 1.4, "wrist": 2.1}
    assert isinstance(answer(asked(folded)), Free)
    met = answer(asked(folded, holds=(held(TURNED),)))
    assert isinstance(met, CollisionFound), met
    assert (met.kind, {met.link, met.other}, {met.held, met.other_held}) == ("self", {"hand", "upper"}, {"bar", ""})


def test_what_another_robot_holds_is_met_where_that_robot_is() -> None:
    away = Pose((2.6, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))  # it points at the first one: its hand ends 1.4 m from it
    other = Placement("you", "arm", away, (STRETCHED,))
    begin = MotionPath(STRETCHED | {"shoulder": 0.5}, (PathSegment({"shoulder": -0.5}),))
    question = Check(Placement("me", "arm", at(0, 0)), (begin,), (other,), (), 30.0)
    assert isinstance(answer(question), Free)
    holding = Placement("you", "arm", away, (STRETCHED,), holds=(held(at(0.5, 0.0)),))
    met = answer(Check(question.robot, (begin,), (holding,), (), 30.0))
    assert isinstance(met, CollisionFound), met
    assert (met.kind, met.name, met.other, met.other_held) == ("robot", "you", "hand", "bar")


def test_a_held_object_leaves_the_table_that_it_stood_on() -> None:
    """It touches the table at the start: it may rise, and may not be pushed down."""
    table = thing("table", at(1.5, -0.07))
    holds = (held(),)
    assert isinstance(answer(asked({"shoulder": 0.6}, table, holds=holds), table=Box((0.6, 0.1, 0.1))), Free)
    met = answer(asked({"shoulder": -0.3}, table, holds=holds), table=Box((0.6, 0.1, 0.1)))
    assert isinstance(met, CollisionFound) and met.held == "bar", met


def test_a_hand_may_touch_what_is_named_and_nothing_else_may() -> None:
    cup = thing("cup", at(0.0, 1.1))
    question = asked({"shoulder": math.pi}, cup)
    assert isinstance(answer(question, cup=POST), CollisionFound)
    named = Check(question.robot, question.paths, (), (cup,), 30.0, may_touch=("cup",), hand=("hand",))
    assert isinstance(answer(named, cup=POST), Free)
    by_another_part = Check(question.robot, question.paths, (), (cup,), 30.0, may_touch=("cup",), hand=("lower",))
    met = answer(by_another_part, cup=POST)
    assert isinstance(met, CollisionFound) and met.link == "hand"


def test_what_is_held_may_touch_what_is_named() -> None:
    post = thing("post", at(0.0, 1.6))
    question = asked({"shoulder": math.pi}, post, holds=(held(),))
    named = Check(question.robot, question.paths, (), (post,), 30.0, may_touch=("post",), hand=("hand",))
    assert isinstance(answer(named, post=POST), Free)


def test_another_robot_may_not_be_touched_by_naming_it() -> None:
    other = Placement("cup", "arm", at(0.0, 1.1), (STRETCHED,))
    question = asked({"shoulder": math.pi}, others=(other,))
    named = Check(question.robot, question.paths, (other,), (), 30.0, may_touch=("cup", "hand"), hand=("hand",))
    assert isinstance(answer(named), CollisionFound)


def test_an_object_that_is_not_prepared_is_said() -> None:
    failed = answer(asked({"shoulder": 1.0}, holds=(held(key="unknown"),)))
    assert isinstance(failed, CheckFailed)


def test_what_a_robot_without_shapes_holds_makes_its_links_reach_further() -> None:
    """Its unchecked links reach 1.8 m at most from its root, and what it holds 1 m further."""
    base = at(3.5, 0.0)
    question = asked({"shoulder": 1.0}, others=(Placement("you", "unseen", base, (STRETCHED,)),))
    assert isinstance(answer(question), Free)
    holding = Placement("you", "unseen", base, (STRETCHED,), holds=(held(),))
    refused = answer(Check(question.robot, question.paths, (holding,), (), 30.0))
    assert not isinstance(refused, Free | CheckFailed), refused
