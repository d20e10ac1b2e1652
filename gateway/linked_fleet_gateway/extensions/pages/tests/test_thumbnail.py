"""The drawing of a robot on its card: of its present pose, small, and of any robot that there may be."""

import re
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from pyoxigraph import Literal

from linked_fleet_gateway.extensions.pages.branches import THUMBNAILS
from linked_fleet_gateway.extensions.pages.thumbnail import HEIGHT, SVG, WIDTH, drawing
from linked_fleet_gateway.resources.annotations import read_charge
from linked_fleet_gateway.resources.branches import Branches
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.invocations import Invocations

_ARM = {f"j{number}": ("revolute", '<origin xyz="0 0 0.3" rpy="1 0 0"/>') for number in range(3)}
NS = "http://www.w3.org/2000/svg"
_NUMBER = re.compile(r"-?\d+\.?\d*")


def _points(svg: bytes) -> list[list[float]]:
    paths = ET.fromstring(svg).iter(f"{{{NS}}}path")
    return [[float(each) for each in _NUMBER.findall(path.get("d", ""))] for path in paths]


def test_another_pose_is_another_drawing(bench: Any) -> None:
    """The thumbnail depends on the robot alone: the same pose gives the same bytes."""
    straight, bent = bench.robot(_ARM, [0, 0, 0]), bench.robot(_ARM, [1, 0, 0], name="other")
    assert drawing(straight) == drawing(bench.robot(_ARM, [0, 0, 0], name="third")) != drawing(bent)


def test_the_robot_fills_its_frame_and_stays_in_it(bench: Any) -> None:
    found = _points(drawing(bench.robot(_ARM, [0.4, -1, 0.3])))
    across = [each for path in found for each in path[::2]]
    down = [each for path in found for each in path[1::2]]
    assert min(across) >= 0 and max(across) <= WIDTH and min(down) >= 0 and max(down) <= HEIGHT
    assert max(max(across) - min(across), max(down) - min(down)) > HEIGHT * 0.6


def test_an_unknown_pose_is_not_drawn(bench: Any) -> None:
    root = ET.fromstring(drawing(bench.robot(_ARM, None)))
    assert [each.text for each in root] == ["?"] and not list(root.iter(f"{{{NS}}}path"))


@pytest.mark.parametrize("offset", ["1e300 0 0", "0 0 0", "1e-12 0 0"])
def test_absurd_robots_are_drawn_in_finite_numbers(bench: Any, offset: str) -> None:
    joints = {"a": ("continuous", f'<origin xyz="{offset}"/>'), "b": ("continuous", f'<origin xyz="{offset}"/>')}
    svg = drawing(bench.robot(joints, [0, 0])).decode()
    assert "nan" not in svg and "inf" not in svg and len(svg) < 2000


def test_a_thumbnail_is_a_resource_below_its_robot(bench: Any) -> None:
    robot = bench.robot(_ARM, [0, 0, 0])
    resource = _resolved(bench, "/r/thumbnail")
    assert resource.documents[SVG]() == drawing(robot) and resource.describe is None


def _resolved(bench: Any, path: str) -> Any:
    return Tree(bench.fleet, Invocations(), bench.base, branches=Branches().with_branches(THUMBNAILS)).resolve(path)


@pytest.mark.parametrize(
    ("said", "percent"),
    [
        ("80", 80),
        ("12.5", 12.5),
        ("101", None),
        ("-1", None),
        ('"full"', None),
        ("1e1", 10),
        ('"NaN"^^xsd:double', None),
    ],
)
def test_a_battery_is_listed_as_its_robot_says(bench: Any, said: str, percent: float | None) -> None:
    """A value that is not a number from 0 to 100 is no charge."""
    robot = bench.robot(_ARM, annotations=f"<> lf:batteryCharge {said} .")
    expected = [] if percent is None else [percent]
    assert [charge for each in robot.annotations if (charge := read_charge(each)) is not None] == expected
    assert [float(each.value) for each in _charges(bench)] == expected


def _charges(bench: Any) -> list[Literal]:
    """As the fleet lists them."""
    triples = _resolved(bench, "/").full_graph(bench.base).triples
    return [each.object for each in triples if each.predicate == LF.batteryCharge]


def test_the_battery_charge_comes_from_the_annotations_of_the_agent(bench: Any) -> None:
    bench.robot(_ARM, annotations="<> lf:batteryCharge 80 .")
    bench.fleet.configure("r", {"annotations": bench.prefixed("<./> lf:batteryCharge 5 .")})
    assert [each.value for each in _charges(bench)] == ["80.0"]
