"""What a robot adds to the shape of an action: limits rounded inwards, speeds, distances, its own joints and links."""

import math
from decimal import Decimal
from operator import ge, le
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.resources.joint_limits import MAX_TURNS, maximum_literal, minimum_literal, position_bounds
from linked_fleet_gateway.resources.shape_parameters import COMPLETIONS, commandable_joints, moved_links
from linked_fleet_rdf.graph import DEGREE, METRE, MILLIMETRE, RADIAN, UNITS
from linked_fleet_rdf.shapes import load_turtle
from linked_fleet_rdf.vocabulary import LF, XSD
from linked_fleet_state.model import RobotModel
from linked_fleet_state.observation import rounded

_URDF = """<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="{}"><parent link="a"/>
<child link="b"/><axis xyz="0 0 1"/><limit lower="{!r}" upper="{!r}" velocity="2" effort="1"/></joint></robot>"""
_ELBOW = {"elbow": ("revolute", '<limit lower="-1" upper="2" velocity="2" effort="1"/>')}
_MIMIC = {"finger": ("revolute", '<limit lower="-1" upper="2" effort="1" velocity="1"/><mimic joint="elbow"/>')}
_FREE = {"free": ("revolute", "")}
_FLAP = {"flap": ("floating", "")}
_WHEEL = {"wheel": ("continuous", "")}
_LIFT = {"lift": ("prismatic", '<limit lower="0" upper="0.04" velocity="0.1" effort="1"/>')}
_ends = st.floats(-1e3, 1e3, allow_nan=False)


def _admitted(bench: Any, path: str, body: str) -> bool:
    try:
        bench.body(path, body)
    except UnprocessableContent as error:
        assert error.report
        return False
    return True


@settings(derandomize=True)
@given(_ends, _ends, st.sampled_from([DEGREE, RADIAN, MILLIMETRE, METRE]))
def test_bounds_are_rounded_inwards(one: float, other: float, unit: Any) -> None:
    """To a millionth of the unit, or outwards to the position that is shown at the limit.

    A thousandth of that is tolerated for binary fractions.
    """
    low, high = sorted((one, other))
    assume(low or high)  # two zeros state no range
    kind = "revolute" if unit in (DEGREE, RADIAN) else "prismatic"
    joint = RobotModel.parse(_URDF.format(kind, low, high)).joints["j"]
    stated = position_bounds(joint, unit)
    assert min(-1.1e-9, (rounded(low, 1e-5) - low) / unit.si - 1.1e-9) <= stated[0] - low / unit.si <= 1.1e-6
    assert min(-1.1e-9, (high - rounded(high, 1e-5)) / unit.si - 1.1e-9) <= high / unit.si - stated[1] <= 1.1e-6
    limits = [float(each.value) for each in (minimum_literal(stated[0]), maximum_literal(stated[1]))]
    assert limits == pytest.approx(stated, rel=5e-15)


@settings(derandomize=True)
@given(st.integers(-400_000_000, 400_000_000))
def test_a_limit_conforms_to_itself_as_every_type_of_number(millionths: int) -> None:
    """Validators compare exactly: 1.047 as a double is less than 1.047 as a decimal, and both must conform."""
    text = str(Decimal(millionths).scaleb(-6))
    for limit, compare in ((minimum_literal(float(text)), ge), (maximum_literal(float(text)), le)):
        assert limit.datatype == XSD.double
        for number in (Decimal(text), float(text), Decimal(limit.value), float(limit.value)):
            assert compare(number, float(limit.value)), (text, limit, number)


def test_bounds_of_a_joint_without_ends() -> None:
    """From 0 up to, but excluding, one turn."""
    joint = RobotModel.parse(_URDF.format("continuous", 0.0, 0.0)).joints["j"]
    assert position_bounds(joint, DEGREE) == (0.0, 360.0)
    assert position_bounds(joint, RADIAN) == (0.0, round(math.tau, 6))


def test_the_shape_admits_its_bounds_and_nothing_past_them(bench: Any) -> None:
    """Inclusive at both ends of a limited joint; the whole turn of a continuous one equals its beginning."""
    bench.robot({**_ELBOW, **_WHEEL})
    body = "<> vom:numericalValue {} ; vom:unit unit:{} ."
    for value, unit, good in (
        ("-1", "RAD", True),
        ("2", "RAD", True),
        ("2.000001", "RAD", False),
        ("-1.000001", "RAD", False),
        ("114.591559", "DEG", True),
        ("114.59156", "DEG", False),
    ):
        assert _admitted(bench, "/r/elbow/actions/rotate", body.format(value, unit)) is good, value
    for value, good in (("0", True), ("359.999999", True), ("360", False), ("-0.000001", False)):
        assert _admitted(bench, "/r/wheel/actions/rotate", body.format(value, "DEG")) is good, value


@pytest.mark.parametrize("limit", [0.820305, 0.820306, 0.820304, 0.8203049, -0.820305, math.pi, -math.pi, 1e-7])
def test_a_position_as_it_is_read_is_a_valid_target(bench: Any, limit: float) -> None:
    """Values are shown in steps of 1e-5 rad, so a joint at its limit may be shown beyond it."""
    other = limit + math.copysign(1.0, limit)
    low, high = sorted((limit, other))
    bench.robot({"elbow": ("revolute", f'<limit lower="{low!r}" upper="{high!r}" velocity="1" effort="1"/>')}, [limit])
    (shown,) = [
        triple.object.value
        for triple in bench.described("/r/elbow/rotation").triples
        if triple.predicate.value.endswith("numericalValue")
    ]
    body = f"<> vom:numericalValue {shown} ; vom:unit unit:RAD ."
    motion = bench.plan("/r/elbow/actions/rotate", body)
    (target,) = motion.targets.values()
    assert low <= target <= high
    assert target == pytest.approx(limit, abs=5.1e-6)
    beyond = float(shown) - math.copysign(1e-5, limit)
    assert not _admitted(bench, "/r/elbow/actions/rotate", body.replace(shown, repr(beyond)))


def test_speeds_are_above_zero_and_within_the_joints_own(bench: Any) -> None:
    """2 rad/s are 114.591559 °/s; a joint without a maximum speed accepts 10 rad/s or 10 m/s."""
    slide = {"slide": ("prismatic", '<limit lower="0" upper="1" effort="1"/>')}
    bench.robot({**_ELBOW, **_WHEEL, **slide})
    for joint, action, value, unit, good in (
        ("elbow", "rotate", "2", "RAD-PER-SEC", True),
        ("elbow", "rotate", "2.1", "RAD-PER-SEC", False),
        ("elbow", "rotate", "114.591559", "DEG-PER-SEC", True),
        ("elbow", "rotate", "114.6", "DEG-PER-SEC", False),
        ("elbow", "rotate", "0", "RAD-PER-SEC", False),
        ("elbow", "rotate", "-1", "RAD-PER-SEC", False),
        ("elbow", "rotate", "1", "RAD", False),
        ("elbow", "rotate", "1", "M-PER-SEC", False),
        ("wheel", "rotate", "10", "RAD-PER-SEC", True),
        ("wheel", "rotateBy", "10.1", "RAD-PER-SEC", False),
        ("slide", "translate", "10000", "MilliM-PER-SEC", True),
        ("slide", "translateBy", "10.1", "M-PER-SEC", False),
    ):
        position = f"vom:numericalValue 0 ; vom:unit unit:{'M' if joint == 'slide' else 'RAD'}"
        speed = f"lf:speed [ vom:numericalValue {value} ; vom:unit unit:{unit} ]"
        assert _admitted(bench, f"/r/{joint}/actions/{action}", f"<> {position} ; {speed} .") is good, (value, unit)


def test_distances_span_the_range_of_the_joint(bench: Any) -> None:
    """In both directions; ten turns without limits."""
    bench.robot({**_ELBOW, **_WHEEL, **_LIFT})
    for path, value, unit, good in (
        ("elbow/actions/rotateBy", "3", "RAD", True),
        ("elbow/actions/rotateBy", "-3", "RAD", True),
        ("elbow/actions/rotateBy", "3.000001", "RAD", False),
        ("wheel/actions/rotateBy", str(360 * MAX_TURNS), "DEG", True),
        ("wheel/actions/rotateBy", str(-360 * MAX_TURNS - 1), "DEG", False),
        ("lift/actions/translateBy", "-40", "MilliM", True),
        ("lift/actions/translateBy", "40.1", "MilliM", False),
    ):
        body = f"<> vom:numericalValue {value} ; vom:unit unit:{unit} ."
        assert _admitted(bench, f"/r/{path}", body) is good, (path, value)


def test_targets_have_the_limits_of_the_joint_that_they_name(bench: Any) -> None:
    """Not those of another joint, nor its units; a joint that accepts no command cannot be named."""
    bench.robot({**_ELBOW, **_LIFT, **_MIMIC, **_FREE, "plate": ("fixed", "")})
    body = "<> lf:target [ lf:ofJoint <{}> ; vom:numericalValue {} ; vom:unit unit:{} ] ."
    for joint, value, unit, good in (
        ("/r/elbow", "2", "RAD", True),
        ("/r/elbow", "2.1", "RAD", False),
        ("/r/elbow", "0.01", "M", False),
        ("/r/lift", "40", "MilliM", True),
        ("/r/lift", "40", "M", False),
        ("/r/lift", "0.01", "RAD", False),
        *((f"/r/{name}", "0", "RAD", False) for name in ("finger", "free", "plate", "nobody", "elbow_link", "elbow/")),
        ("/s/elbow", "0", "RAD", False),
        ("http://example.com/r/elbow", "0", "RAD", False),
    ):
        assert _admitted(bench, "/r/actions/moveJoints", body.format(joint, value, unit)) is good, (joint, value)


def test_joints_that_take_commands(bench: Any) -> None:
    """Of the joints in the description: those that move by themselves, within known limits."""
    joints = {**_ELBOW, **_MIMIC, **_FREE, **_WHEEL, **_LIFT, "plate": ("fixed", ""), **_FLAP}
    robot = bench.robot(joints)
    assert [joint.name for joint in commandable_joints(robot)] == ["elbow", "wheel", "lift"]
    robot = bench.robot(joints, listed=["lift", "finger", "elbow"])
    assert [joint.name for joint in commandable_joints(robot)] == ["lift", "elbow"]


def test_links_that_move(bench: Any) -> None:
    """All below a joint that accepts commands, however far; a mimicking joint moves nothing by itself."""
    robot = bench.robot({"plate": ("fixed", ""), **_ELBOW, **_FREE, **_FLAP})
    assert moved_links(robot) == ["elbow_link", "free_link", "flap_link"]
    assert moved_links(bench.robot({**_FREE, "plate": ("fixed", "")})) == []


def test_every_completion_that_a_shape_names_is_known() -> None:
    """And no unused completion is known."""
    named = {t.object for about in load_turtle("actions").values() for t in about if t.predicate == LF.completedBy}
    assert named == set(COMPLETIONS)


def test_every_unit_that_a_shape_admits_has_a_size() -> None:
    """A body is converted by the table of units alone."""
    admitted = {iri for unit in (DEGREE, RADIAN, METRE, MILLIMETRE) for iri in unit.accepted}
    assert admitted <= set(UNITS)
    assert all(unit.si > 0 for unit in UNITS.values())
