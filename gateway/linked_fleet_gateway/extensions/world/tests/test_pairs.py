"""The pairs of a robot's parts that are checked against each other."""

from linked_fleet_gateway.extensions.world.shapes import build_robot


def _link(name: str, size: str = ".2 .02 .02", x: float = 0.125) -> str:
    shape = f'<origin xyz="{x} 0 0"/><geometry><box size="{size}"/></geometry>'
    return f'<link name="{name}"><collision>{shape}</collision></link>'


def _joint(name: str, parent: str, child: str, x: float, kind: str = "continuous", more: str = "") -> str:
    limit = '<limit lower="0" upper="0.1" velocity="1" effort="1"/>' if kind == "prismatic" else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>{limit}{more}</joint>'
    )


def pairs(*parts: str) -> set[frozenset[str]]:
    robot = build_robot(f"<robot name='r'>{''.join(parts)}</robot>")
    return {frozenset((robot.bodies[i].link, robot.bodies[j].link)) for i, j in robot.pairs}


def _chain(offset_m: float, size: str = ".2 .02 .02") -> set[frozenset[str]]:
    links = [_link(name, size, 0.125 if offset_m > 0.1 else 0.0) for name in "abc"]
    return pairs(*links, _joint("ab", "a", "b", 0.25), _joint("bc", "b", "c", offset_m))


def test_neighbours_are_left_to_themselves_and_the_next_but_one_is_not() -> None:
    assert _chain(0.25) == {frozenset("ac")}


def test_two_joints_at_nearly_one_place_are_one() -> None:
    assert _chain(0.01) == set()


def test_links_with_a_fixed_joint_are_one_body() -> None:
    fixed = _joint("bd", "b", "d", 0.1, kind="fixed")
    found = pairs(*map(_link, "abcd"), _joint("ab", "a", "b", 0.25), _joint("bc", "b", "c", 0.25), fixed)
    assert found == {frozenset("ac")}


def test_parts_that_touch_in_most_positions_are_drawn_so() -> None:
    """A ball of 30 cm around each joint."""
    assert _chain(0.12, ".6 .6 .6") == set()


def test_the_sides_of_a_gripper_are_made_to_touch() -> None:
    fingers = _joint("left", "a", "b", 0.1, "prismatic"), _joint("right", "a", "c", 0.2, "prismatic", "{}")
    links = [*map(_link, "a"), _link("b", ".01 .01 .01", 0), _link("c", ".01 .01 .01", 0)]
    plain, coupled = (
        pairs(*links, fingers[0], fingers[1].format(more)) for more in ("", "<mimic joint='left' multiplier='-1'/>")
    )
    assert (plain, coupled) == ({frozenset("bc")}, set())
