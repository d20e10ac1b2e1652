"""Paths: any name has exactly one segment, and every segment leads back to its name."""

from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.resources.paths import (
    joint_or_link,
    joint_path,
    link_path,
    reserved_at_root,
    reserved_in_robot,
    robot_name,
    robot_path,
    thing_at,
)
from linked_fleet_state.model import RobotModel

_TWINS = """<robot name="twins">
  <link name="base"/><link name="subscriptions"/><link name="a b/ü"/><link name="j~link"/>
  <joint name="subscriptions" type="fixed"><parent link="base"/><child link="subscriptions"/></joint>
  <joint name="j" type="fixed"><parent link="base"/><child link="a b/ü"/></joint>
  <joint name="jointState" type="fixed"><parent link="base"/><child link="j~link"/></joint>
</robot>"""


@given(st.one_of(st.sampled_from(sorted(reserved_at_root())), st.text(min_size=1, max_size=30)))
def test_any_robot_name_has_a_safe_segment_that_leads_back(name: str) -> None:
    """Only unreserved characters of RFC 3986, never a reserved word or a dot segment."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return
    segment = robot_path(name)[1:-1]
    assert all(character.isascii() and (character.isalnum() or character in "-._~") for character in segment)
    assert segment not in reserved_at_root() | {".", ".."}
    assert robot_name(segment) == name


@pytest.mark.parametrize("segment", ["health", "~", "~2", "~zz", "~61", "a%20b", "~C3", "", "a~2f"])
def test_other_spellings_name_nothing(segment: str) -> None:
    """One name, one URI: superfluous, lower-case or broken escapes are refused."""
    with pytest.raises(ValueError, match=r"segment|name"):
        robot_name(segment)


def test_joint_and_link_of_one_name_and_reserved_names_are_told_apart() -> None:
    """The joint keeps the plain segment, the link is marked; no part can replace a resource of the robot."""
    model = RobotModel.parse(_TWINS)
    paths = {joint_path("r", name): (name, None) for name in model.joints}
    paths |= {link_path("r", model, name): (None, name) for name in model.links}
    assert len(paths) == 7
    for path, part in paths.items():
        segment = path.removeprefix("/r/")
        assert segment not in reserved_in_robot()
        assert joint_or_link(segment, model) == part
    with pytest.raises(ValueError, match="neither"):
        joint_or_link("base~link", model)


def test_a_path_leads_to_a_robot_and_its_part() -> None:
    model = RobotModel.parse(_TWINS)
    robot, bare = SimpleNamespace(name="r", model=model, parts={}), SimpleNamespace(name="new", model=None)
    robots = cast(Any, {"r": robot, "new": bare})
    assert thing_at("/r/", robots) == (robot, None) and thing_at("/new/", robots) == (bare, None)
    assert thing_at(joint_path("r", "j"), robots) == (robot, model.joints["j"])
    assert thing_at(link_path("r", model, "subscriptions"), robots) == (robot, model.links["subscriptions"])
    for path in ("/", "/r", "/r/none", "/r/j/rotation", "/new/j", "/s/", "/health/", "/~/"):
        assert thing_at(path, robots) is None
