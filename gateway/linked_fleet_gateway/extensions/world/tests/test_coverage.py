"""Links that the check does not cover: named with the reason, and refused near what they might meet."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.extensions.world import shapes
from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    Free,
    MotionPath,
    PathSegment,
    Placement,
    Prepare,
    Ready,
    UncheckedNear,
)
from linked_fleet_gateway.extensions.world.reach import UNKNOWN_M
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.scene import Box
from linked_fleet_gateway.extensions.world.shapes import build_object_shape, build_robot
from linked_fleet_gateway.extensions.world.surfaces import MeshCache, Surface
from linked_fleet_gateway.extensions.world.worker import Worker
from linked_fleet_state.model import Pose
from linked_fleet_state.unchecked import UncheckedLink
from linked_fleet_state.xml import ModelError
from meshes import BOX, read

WHOLE = "<collision><geometry><box size='.1 .1 .1'/></geometry></collision>"
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
KNOWN = "a.stl"


def part(kind: str, form: str) -> str:
    return f"<{kind}><geometry>{form}</geometry></{kind}>"


def mesh(uri: str, more: str = "") -> str:
    return f"<mesh filename='{uri}' {more}/>"


def arm(tool: str, name: str = "tool", joint: str = "<joint name='j' type='continuous'>") -> str:
    return (
        f"<robot name='r'><link name='base'>{WHOLE}</link>"
        f"<link name='{name}'>{tool}</link>{joint}<parent link='base'/><child link='{name}'/>"
        f"<origin xyz='0 0 .4'/><axis xyz='0 1 0'/></joint></robot>"
    )


def surface_of(uri: str) -> Surface:
    if uri != KNOWN:
        raise ModelError("it cannot be read as stl")
    return read(BOX)


def built(tool: str, **more: str) -> Robot:
    return build_robot(arm(tool, **more), {KNOWN, "bad.stl"}, surface_of)


@pytest.mark.parametrize(
    ("tool", "uri", "reason"),
    [
        (part("collision", mesh("none.stl")), "none.stl", "the agent does not offer it"),
        (part("collision", mesh("bad.stl")), "bad.stl", "it cannot be read as stl"),
        (part("collision", mesh("none.stl")) + part("visual", mesh("none.dae")), "none.stl", "does not offer it"),
        (part("collision", mesh("")), "", "the agent does not offer it"),
        (part("collision", mesh(KNOWN, "scale='0 0 0'")), KNOWN, "no factor may be zero"),
        (part("collision", mesh(KNOWN, "scale='1e300 1 1'")), KNOWN, "beyond 1e+12"),
        (part("collision", mesh(KNOWN, "scale='1 1'")), KNOWN, "not three numbers"),
        (part("collision", "<sphere radius='-1'/>"), "", "a sphere with radius -1.0, which must be above zero"),
        (part("collision", "<sphere radius='0'/>"), "", "a sphere with radius 0.0, which must be above zero"),
        (part("collision", "<sphere/>"), "", "lacks radius"),
        (part("collision", "<sphere radius='nan'/>"), "", "not a finite number"),
        (part("collision", "<box size='0 0 0'/>"), "", "a box of size '0 0 0'; each length must be above zero"),
        (part("collision", "<box size='1 -1 1'/>"), "", "a box of size '1 -1 1'; each length must be above zero"),
        (
            part("collision", "<cylinder radius='1' length='0'/>"),
            "",
            "with length 0.0, which must be above",
        ),
        (
            part("collision", "<cylinder radius='-1' length='1'/>"),
            "",
            "with radius -1.0, which must be above",
        ),
        (part("collision", "<sphere radius='1e7'/>"), "", "larger or further away than 100 m"),
        (part("collision", "<torus/>"), "", "is none of box, sphere, cylinder, capsule, mesh"),
        ("<collision/>", "", "has no geometry"),
        (part("collision", "<box size='1 1 1'/>") + part("collision", mesh("none.stl")), "none.stl", "does not offer"),
    ],
)
def test_a_link_that_is_not_covered_is_named_with_its_mesh_and_the_reason(tool: str, uri: str, reason: str) -> None:
    (unchecked,) = built(tool).unchecked
    assert (unchecked.link, unchecked.mesh) == ("tool", uri) and reason in unchecked.reason


@pytest.mark.parametrize(
    "tool",
    [
        "",
        part("visual", mesh("none.stl")),
        part("visual", "<box size='1 1 1'/>"),
        part("collision", mesh(KNOWN)),
        part("collision", mesh(KNOWN)) + part("visual", mesh("none.dae")),
        part("collision", mesh("none.stl")) + part("visual", mesh(KNOWN)),
        part("collision", mesh("bad.stl")) + part("visual", "<box size='1 1 1'/>"),
    ],
)
def test_a_link_without_a_body_or_with_a_replacement_is_covered(tool: str) -> None:
    """By URDF a link without collision geometry meets nothing, whatever it looks like."""
    assert built(tool).unchecked == ()


def test_the_usable_parts_of_an_unchecked_link_are_checked() -> None:
    robot = built(part("collision", "<box size='1 1 1'/>") + part("collision", mesh("none.stl")))
    assert [each.link for each in robot.bodies] == ["base", "tool"]


@pytest.mark.parametrize("name", ["tool", "a tool", "a tool ", " tool"])
def test_a_link_whose_name_has_spaces_is_covered(name: str) -> None:
    robot = built(part("collision", "<box size='1 1 1'/>"), name=name)
    assert robot.unchecked == () and [each.link for each in robot.bodies] == ["base", name.strip()]


def test_a_robot_that_no_library_takes_is_unchecked_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(urdf: str, floating: bool) -> None:
        raise ModelError("400 degrees of freedom are too many")

    monkeypatch.setattr(shapes, "build_model", refuse)
    robot = built(part("collision", mesh(KNOWN)))
    why = "400 degrees of freedom are too many"
    assert robot.unchecked == (UncheckedLink("base", "", why), UncheckedLink("tool", "", why))
    assert robot.unchecked_m == pytest.approx(0.4 + UNKNOWN_M)


def test_the_worker_names_unusable_meshes_and_robots() -> None:
    worker, urdf = Worker(MeshCache(None)), arm(part("collision", mesh("u.stl")))
    unusable = worker.answer(Prepare("r", urdf, {"u.stl": "0.stl"}, {"0.stl": "it cannot be read as stl"}))
    assert isinstance(unusable, Ready)
    assert unusable.unchecked == (UncheckedLink("tool", "u.stl", "it cannot be read as stl"),)
    ended = worker.answer(Prepare("r", urdf, {}, {}, "the process ended"))
    assert isinstance(ended, Ready)
    assert ended.unchecked == tuple(UncheckedLink(link, "", "the process ended") for link in ("base", "tool"))


# -- motions --------------------------------------------------------------------------------------------------

REACH_M = 0.4 + UNKNOWN_M
GAPPY = part("collision", mesh("none.stl"))


def at(x: float) -> Pose:
    return Pose((x, 0.0, 0.0), UPRIGHT)


def go(mover: str, *, neighbour: str = "", x: float = 0.0, thing_x: float | None = None,
       accepts: tuple[bool, bool] = (False, False)) -> Answer:  # fmt: skip
    robots = {"mover": built(mover), "neighbour": built(neighbour)}
    objects = {"crate": build_object_shape(Box((0.2, 0.2, 0.2)))}
    others = (Placement("other", "neighbour", at(x), ({"j": 0.0},), accepts[1]),) if neighbour else ()
    things = () if thing_x is None else (Placement("crate", "crate", at(thing_x)),)
    path = MotionPath({"j": 0.0}, (PathSegment({"j": 0.5}),))
    asked = Check(Placement("me", "mover", at(0.0), (), accepts[0]), (path,), others, things, 30.0)
    return check(asked, robots, objects)


def test_a_robot_with_unchecked_links_moves_where_nothing_is_near() -> None:
    assert isinstance(go(GAPPY), Free)
    assert isinstance(go(GAPPY, thing_x=REACH_M + 0.3), Free)
    assert isinstance(go(GAPPY, neighbour=WHOLE, x=REACH_M + 1.0), Free)


def test_a_robot_with_unchecked_links_is_refused_near_others() -> None:
    assert go(GAPPY, thing_x=REACH_M) == UncheckedNear(True, "object", "crate")
    assert go(GAPPY, neighbour=WHOLE, x=REACH_M) == UncheckedNear(True, "robot", "other")


def test_a_robot_is_refused_near_a_neighbour_with_unchecked_links() -> None:
    assert go(WHOLE, neighbour=GAPPY, x=REACH_M) == UncheckedNear(False, "robot", "other")
    assert isinstance(go(WHOLE, neighbour=GAPPY, x=REACH_M + 1.0), Free)


def test_unchecked_links_that_a_placement_accepts_are_ignored_and_named() -> None:
    assert isinstance(go(GAPPY, thing_x=1.0, accepts=(True, False)), Free)
    free = go(WHOLE, neighbour=GAPPY, x=1.2, accepts=(False, True))
    assert isinstance(free, Free) and free.unchecked == ("other",)
    assert isinstance(go(WHOLE, neighbour=GAPPY, x=1.2, accepts=(True, False)), UncheckedNear)


def test_a_robot_without_any_checked_link_is_not_found_free() -> None:
    robot = build_robot("<robot name='r'><link name='a'>" + GAPPY + "</link></robot>")
    asked = Check(Placement("me", "r", at(0.0)), (MotionPath({}, (PathSegment({}),)),), (), (), 30.0)
    answer = check(asked, {"r": robot}, {})
    assert isinstance(answer, Free) and not answer.covered


FORMS = (
    "<box size='.1 .1 .1'/>", "<box size='0 0 0'/>", "<sphere radius='.1'/>", "<sphere radius='-1'/>", "<torus/>",
    mesh(KNOWN), mesh("bad.stl"), mesh("none.stl"), mesh(""), mesh(KNOWN, "scale='0 0 0'"),
)  # fmt: skip
PARTS = st.lists(st.tuples(st.sampled_from(("collision", "visual")), st.sampled_from(FORMS)), max_size=4)
USABLE = {FORMS[0], FORMS[2], mesh(KNOWN)}


@given(base=PARTS, tool=PARTS)
def test_a_link_is_covered_by_all_its_shapes_or_is_named(
    base: list[tuple[str, str]], tool: list[tuple[str, str]]
) -> None:
    """Whatever is found free, each link with collision geometry has a body for each part, or is unchecked."""
    links = {"base": base, "tool": tool}
    text = "".join(f"<link name='{name}'>{''.join(part(*each) for each in of)}</link>" for name, of in links.items())
    joint = "<joint name='j' type='continuous'><parent link='base'/><child link='tool'/></joint>"
    robot = build_robot(f"<robot name='r'>{text}{joint}</robot>", {KNOWN, "bad.stl"}, surface_of)
    named = {each.link for each in robot.unchecked}
    for name, of in links.items():
        parts = {kind: [form for each, form in of if each == kind] for kind in ("collision", "visual")}
        sound = {kind: set(forms) <= USABLE for kind, forms in parts.items()}
        used = parts["collision"] if sound["collision"] else parts["visual"]
        covered = sound["collision"] or (bool(parts["visual"]) and sound["visual"])
        assert (name in named) is not covered
        if covered:
            assert sum(each.link == name for each in robot.bodies) == len(used)
