"""Named poses are read from annotations, which anybody may have written."""

import math
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from linked_fleet_gateway.resources.annotations import named_poses
from properties import examples

_JOINTS = {
    "elbow": ("revolute", '<limit lower="-1" upper="2" velocity="1" effort="1"/>'),
    "lift": ("prismatic", '<limit lower="0" upper="0.04" velocity="1" effort="1"/>'),
    "finger": ("revolute", '<limit lower="-1" upper="2" velocity="1" effort="1"/><mimic joint="elbow"/>'),
    "plate": ("fixed", ""),
    "pose": ("continuous", ""),
    "ä/~": ("continuous", ""),
}
_GOOD = "lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 1 ; vom:unit unit:RAD ]"


def _named(title: str, *targets: str) -> str:
    return f'<> lf:namedPose [ dcterms:title "{title}" ; {" ; ".join(targets)} ] .'


def _target(joint: str, value: str, unit: str) -> str:
    return f"lf:target [ lf:ofJoint <{joint}> ; vom:numericalValue {value} ; vom:unit unit:{unit} ]"


def test_poses_are_positions_by_joint_in_si(bench: Any) -> None:
    """By title; every joint by its segment, including escapes."""
    several = [_target("elbow", "90", "DEG"), _target("lift", "20", "MilliM")]
    escaped = [_target("~70ose", "1", "RAD"), _target("~C3~A4~2F~7E", "-180", "DEG")]
    robot = bench.robot(_JOINTS, annotations=_named("up", *several) + _named("odd", *escaped))
    assert named_poses(robot) == {
        "up": {"elbow": pytest.approx(math.pi / 2), "lift": pytest.approx(0.02)},
        "odd": {"pose": 1.0, "ä/~": pytest.approx(-math.pi)},
    }


def test_clients_add_poses_and_take_none_away(bench: Any) -> None:
    """Write poses as the setting stores them, with IRIs relative to the robot."""
    robot = bench.robot(_JOINTS, annotations=_named("agents", _GOOD))
    relative = _named("clients", _GOOD).replace("<>", "<./>").replace("<elbow>", "<./elbow>")
    bench.fleet.configure("r", {"annotations": bench.prefixed(relative)})
    assert named_poses(robot) == {"clients": {"elbow": 1.0}, "agents": {"elbow": 1.0}}
    other = _named("agents", _GOOD.replace("numericalValue 1", "numericalValue 0.5")).replace("<elbow>", "<./elbow>")
    assert other.count("0.5") == 1
    bench.fleet.configure("r", {"annotations": bench.prefixed(other.replace("<>", "<./>"))})
    assert named_poses(robot) == {"agents": {"elbow": 1.0}}


@pytest.mark.parametrize(
    "bad",
    [
        _target("elbow", "2.1", "RAD"),
        _target("lift", "-1", "MilliM"),
        _target("finger", "0", "RAD"),
        _target("plate", "0", "RAD"),
        _target("nobody", "0", "RAD"),
        _target("elbow_link", "0", "RAD"),
        _target("../s/elbow", "0", "RAD"),
        _target("elbow/rotation", "0", "RAD"),
        _target("http://example.com/elbow", "0", "RAD"),
        _target("~65lbow", "0", "RAD"),
        _target("pose", "0", "RAD"),
        _target("", "0", "RAD"),
        _target("elbow", "0", "KiloGM"),
        _target("elbow", "1e999", "RAD"),
        _target("elbow", '"NaN"^^xsd:double', "RAD"),
        _target("elbow", '"INF"^^xsd:double', "RAD"),
        _target("elbow", '"one"', "RAD"),
        _target("elbow", "<1>", "RAD"),
        "lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 1 ]",
        "lf:target [ vom:numericalValue 1 ; vom:unit unit:RAD ]",
        'lf:target [ lf:ofJoint "elbow" ; vom:numericalValue 1 ; vom:unit unit:RAD ]',
        'lf:target "elbow"',
        "lf:target <nowhere>",
    ],
)
def test_a_pose_that_cannot_be_taken_is_none(bench: Any, bad: str) -> None:
    """Alone or beside a valid target; the other poses stay."""
    annotations = _named("good", _GOOD) + _named("bad", bad) + _named("half", _GOOD, bad)
    assert named_poses(bench.robot(_JOINTS, annotations=annotations)) == {"good": {"elbow": 1.0}}


@pytest.mark.parametrize(
    "annotations",
    [
        "<> lf:namedPose <oops",
        "<> lf:namedPose 1 , <x> , [] .",
        _named("no targets").replace("; ]", "]"),
        f"<> lf:namedPose [ {_GOOD} ] .",
        f"<> lf:namedPose [ dcterms:title <up> ; {_GOOD} ] .",
        _named("long" * 40, _GOOD),
        _named("deep", _GOOD) + "<x> lf:p " + "[ lf:p " * 40 + "1" + " ]" * 40 + " .",
        _named("many", _GOOD) + "<x> lf:p " + ",".join(map(str, range(2000))) + " .",
        f'<other> lf:namedPose [ dcterms:title "up" ; {_GOOD} ] .',
        f"<> lf:namedPose <> ; {_GOOD} .",
    ],
)
def test_annotations_that_name_no_pose(bench: Any, annotations: str) -> None:
    """Unparsable, untitled, about another, oversized or circular: no pose and no error."""
    assert named_poses(bench.robot(_JOINTS, annotations=annotations)) == {}


def test_a_robot_without_description_has_no_poses(bench: Any) -> None:
    """Whatever clients call it."""
    robot = bench.robot(_JOINTS, annotations=_named("good", _GOOD))
    robot.reject_description("a test says so")
    assert named_poses(robot) == {}


@settings(
    derandomize=True,
    deadline=None,
    max_examples=examples(150),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_no_annotation_is_an_error(bench: Any, data: st.DataObject) -> None:
    """Any text, and valid annotations truncated or overwritten somewhere."""
    good = _named("good", _GOOD)
    start, end = sorted(data.draw(st.tuples(*[st.integers(0, len(good))] * 2)))
    annotations = good[:start] + data.draw(st.text(max_size=20)) + good[end:]
    found = named_poses(bench.robot(_JOINTS, annotations=annotations))
    assert all(math.isfinite(value) for targets in found.values() for value in targets.values())
