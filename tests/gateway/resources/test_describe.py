"""What the resources of a robot say of its description: findings, limits and unknown values."""

from typing import Any

import pytest
from msgspec import structs
from pyoxigraph import NamedNode

from linked_fleet_rdf.vocabulary import LF, VOM

_SOUND = '<limit lower="-1" upper="2" velocity="2" effort="1"/>'
_DBL_MAX = "1.7976931348623157e308"


def _findings(bench: Any, path: str) -> list[str]:
    return sorted(t.object.value for t in bench.described(path).triples if t.predicate == LF.finding)


def _limit(bench: Any, term: NamedNode) -> str:
    """Return the number of a limit of the elbow, or "unknown"."""
    triples = bench.described("/r/elbow/limits").triples
    (found,) = [t.object for t in triples if t.predicate == term]
    (number,) = [t.object for t in triples if t.subject == found and t.predicate == VOM.numericalValue]
    return "unknown" if number == LF.unknown else str(number.value)


@pytest.mark.parametrize(
    ("inner", "finding"),
    [
        (_SOUND, ""),
        ("", "can be held but not moved: it has no <limit>"),
        (
            '<limit lower="-inf" upper="inf" velocity="2" effort="1"/>',
            "its <limit> states no range (lower '-inf', upper 'inf')",
        ),
        (
            f'<limit lower="-{_DBL_MAX}" upper="{_DBL_MAX}" velocity="2" effort="1"/>',
            "its <limit> states no",
        ),
        ('<limit lower="0" upper="0" velocity="2" effort="1"/>', "its <limit> states no range (lower '0'"),
        ('<limit velocity="2" effort="1"/>', "its <limit> states no range (lower 'absent', upper 'absent')"),
        (
            '<limit lower="2" upper="1" velocity="2" effort="1"/>',
            "the lower limit of joint 'elbow', 2.0, is above",
        ),
        ('<limit lower="x" upper="1" velocity="2" effort="1"/>', "the lower limit of joint 'elbow' is 'x'"),
        (
            '<limit upper="1" velocity="fast" effort="1"/>',
            "the velocity limit of joint 'elbow' is 'fast'",
        ),
        (f'{_SOUND}<mimic joint="nobody"/>', "takes no commands: it mimics 'nobody', which is no joint of this robot"),
        (f'{_SOUND}<mimic joint="elbow"/>', "takes no commands: it mimics itself"),
        (
            f'{_SOUND}<mimic joint="plate"/>',
            "takes no commands: it mimics 'plate', which is no joint of this robot",
        ),
    ],
)
def test_a_joint_says_why_it_has_no_action_to_rotate_it(bench: Any, inner: str, finding: str) -> None:
    """So does its robot, which keeps its other joints; the state is shown all the same."""
    bench.robot({"elbow": ("revolute", inner), "plate": ("fixed", ""), "wrist": ("revolute", _SOUND)}, [0.5])
    assert (bench.resource("/r/elbow/actions/rotate") is None) == bool(finding)
    assert bench.resource("/r/wrist/actions/rotate") is not None
    found = _findings(bench, "/r/elbow")
    assert [finding in each for each in found] == ([True] if finding else [])
    assert _findings(bench, "/r/") == found
    assert bench.fleet.robots["r"].positions["elbow"] == 0.5


@pytest.mark.parametrize("spelling", ["0", "-1", "inf", "-inf", "INF", "1e999", _DBL_MAX, "3.4e38", "0.0"])
def test_no_limit_has_many_spellings_and_is_unknown(bench: Any, spelling: str) -> None:
    limit = f'<limit lower="-1" upper="2" velocity="{spelling}" effort="{spelling}"/>'
    bench.robot({"elbow": ("revolute", limit)})
    assert [_limit(bench, term) for term in (LF.velocityLimit, LF.effortLimit)] == ["unknown", "unknown"]
    stated = f"Joint 'elbow' has the limit of velocity '{spelling}' and effort '{spelling}'"
    assert _findings(bench, "/r/elbow") == [f"{stated}, which mean that no limits are known."]
    assert bench.resource("/r/elbow/actions/rotate") is not None


def test_the_limits_have_the_tolerance_that_the_agent_describes(bench: Any) -> None:
    robot = bench.robot({"elbow": ("revolute", _SOUND)})
    assert _limit(bench, LF.arrivalTolerance) == "unknown"
    before = bench.resource("/r/elbow/limits").source.facts()
    robot.describe(structs.replace(robot.description, tolerances={"elbow": 0.0015, "wrist": 0.5}))
    assert _limit(bench, LF.arrivalTolerance) == "0.0015"
    assert bench.resource("/r/elbow/limits").source.facts() != before


def test_soft_limits_narrow_what_may_be_commanded_and_not_where_the_joint_may_be(bench: Any) -> None:
    soft = '<safety_controller soft_lower_limit="-0.5" soft_upper_limit="1" k_velocity="1"/>'
    robot = bench.robot({"elbow": ("revolute", _SOUND + soft)}, [1.9])
    assert [float(_limit(bench, term)) for term in (LF.lowerLimit, LF.upperLimit)] == [-0.5, 1.0]
    assert _findings(bench, "/r/elbow") == [
        "Joint 'elbow' is moved between its soft limits -0.5 and 1 only; its stops are at -1 and 2."
    ]
    assert robot.joints_outside_limits() == []


def test_a_robot_of_many_findings_states_their_number(bench: Any) -> None:
    bench.robot({f"j{number}": ("revolute", "") for number in range(40)})
    found = _findings(bench, "/r/")
    assert len(found) == 33
    assert "8 more findings are shown at joints and links." in found


def test_a_link_says_which_of_its_shapes_is_left_out(bench: Any) -> None:
    """A description that replaces another one is a new model."""
    robot = bench.robot({"elbow": ("revolute", _SOUND)})
    said, link = robot.description, '<link name="elbow_link">'
    assert said is not None and link in said.urdf and _findings(bench, "/r/elbow_link") == []
    sphere = link + '<collision><geometry><sphere radius="-1"/></geometry></collision>'
    robot.describe(structs.replace(said, urdf=said.urdf.replace(link, sphere)))
    assert _findings(bench, "/r/elbow_link") == [
        "Link 'elbow_link' has a collision shape that is left out: collision shape 1 of link 'elbow_link' is a sphere "
        "with radius -1.0, which must be above zero."
    ]
