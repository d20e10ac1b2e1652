"""From admitted bodies to motions: targets, speeds, and what cannot be planned."""

import math
from typing import Any

import pytest

from linked_fleet_agent.wire.messages import Expectation, Follow, Move
from linked_fleet_base.errors import Conflict, UnprocessableContent
from linked_fleet_gateway.actions.plan import Halt
from linked_fleet_rdf.graph import DEGREE

_ELBOW = {"elbow": ("revolute", '<limit lower="-1" upper="2" velocity="1" effort="1"/>')}
_WHEEL = {"wheel": ("continuous", "")}
_LIFT = {"lift": ("prismatic", '<limit lower="0" upper="0.04" velocity="1" effort="1"/>')}
_RAD = "vom:unit unit:RAD"


def _limited(low: float, high: float) -> dict[str, tuple[str, str]]:
    return {"elbow": ("revolute", f'<limit lower="{low!r}" upper="{high!r}" velocity="1" effort="1"/>')}


def _target(joint: str, value: float, unit: str = "unit:RAD") -> str:
    return f"lf:target [ lf:ofJoint </r/{joint}> ; vom:numericalValue {value} ; vom:unit {unit} ]"


def _waypoint(time: float, *targets: str) -> str:
    return f"lf:waypoint [ lf:atTime {time} ; {' ; '.join(targets)} ]"


# -- joint ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", ["DEG", "RAD"])
@pytest.mark.parametrize(("low", "high"), [(-2.147, 1.047), (-math.pi, math.pi), (0.1, 0.2), (-1e-5, 1e-5)])
def test_admitted_targets_are_within_the_limits(bench: Any, low: float, high: float, unit: str) -> None:
    """A command for exactly the limit that the shape states in any unit does not exceed the URDF's limit."""
    bench.robot(_limited(low, high), (low,))
    size = math.pi / 180 if unit == "DEG" else 1.0
    ends = (math.ceil(low / size * 1e6) / 1e6, math.floor(high / size * 1e6) / 1e6)
    for end in ends:
        plan = bench.plan("/r/elbow/actions/rotate", f"<> vom:numericalValue {end:.6f} ; vom:unit unit:{unit} .")
        assert low <= plan.targets["elbow"] <= high
        assert plan.targets["elbow"] == pytest.approx(end * size)


def test_rounded_limits_are_clamped(bench: Any) -> None:
    """180° is slightly beyond a limit of 3.14159265358 rad, which is stated as 180°; the command is not."""
    bench.robot(_limited(-3.14159265358, 3.14159265358))
    plan = bench.plan("/r/elbow/actions/rotate", "<> vom:numericalValue 180 ; vom:unit unit:DEG .")
    assert plan.targets["elbow"] == 3.14159265358


@pytest.mark.parametrize("present", [0.0, 3.0, -3.0, 100.0])
@pytest.mark.parametrize("degrees", [0, 10, 180, 350])
def test_a_continuous_joint_takes_the_short_way(bench: Any, present: float, degrees: int) -> None:
    """At most half a turn from its position, to an angle equal to the stated one."""
    bench.robot(_WHEEL, (present,))
    plan = bench.plan("/r/wheel/actions/rotate", f"<> vom:numericalValue {degrees} ; vom:unit unit:DEG .")
    assert abs(plan.targets["wheel"] - present) <= math.pi + 1e-9
    assert math.cos(plan.targets["wheel"] - math.radians(degrees)) == pytest.approx(1)


def test_units_are_those_of_the_body(bench: Any) -> None:
    """30 mm is 0.03 m, 60 °/s is π/3 rad/s; a degree has several names."""
    bench.robot(_LIFT)
    plan = bench.plan("/r/lift/actions/translate", "<> vom:numericalValue 30 ; vom:unit unit:MilliM .")
    assert plan.targets == {"lift": pytest.approx(0.03)}
    bench.robot(_ELBOW)
    for iri in DEGREE.accepted:
        speed = "lf:speed [ vom:numericalValue 30 ; vom:unit unit:DEG-PER-SEC ]"
        plan = bench.plan("/r/elbow/actions/rotate", f"<> vom:numericalValue 10 ; vom:unit {iri} ; {speed} .")
        assert plan.motion == Move({"elbow": math.radians(10)}, {"elbow": pytest.approx(math.pi / 6)})


def test_a_distance_counts_from_where_the_joint_is(bench: Any) -> None:
    """Also beyond a whole turn for a continuous joint; exactly up to the limit for a limited one."""
    bench.robot(_ELBOW, (0.5,))
    plan = bench.plan("/r/elbow/actions/rotateBy", f"<> vom:numericalValue -1.5 ; {_RAD} .")
    assert plan.targets == {"elbow": -1.0}
    bench.robot(_WHEEL, (1.0,))
    plan = bench.plan("/r/wheel/actions/rotateBy", "<> vom:numericalValue -720 ; vom:unit unit:DEG .")
    assert plan.targets == {"wheel": pytest.approx(1.0 - 4 * math.pi)}


@pytest.mark.parametrize("distance", ["1.6", "-1.6", "3"])
def test_a_distance_beyond_the_limits_is_a_conflict(bench: Any, distance: str) -> None:
    """The shape does not know the joint's position; the response contains the resulting position and the limits."""
    bench.robot(_ELBOW, (0.5,))
    with pytest.raises(Conflict, match=r"elbow would end at .* limits -1\.0 to 2\.0"):
        bench.plan("/r/elbow/actions/rotateBy", f"<> vom:numericalValue {distance} ; {_RAD} .")


@pytest.mark.parametrize(
    ("joints", "path", "body"),
    [
        (_WHEEL, "/r/wheel/actions/rotate", f"<> vom:numericalValue 1 ; {_RAD} ."),
        (_ELBOW, "/r/elbow/actions/rotateBy", f"<> vom:numericalValue 1 ; {_RAD} ."),
        (_WHEEL, "/r/actions/moveJoints", f"<> {_target('wheel', 1)} ."),
        (_WHEEL, "/r/actions/followTrajectory", f"<> {_waypoint(1, _target('wheel', 1))} ."),
    ],
)
@pytest.mark.parametrize("positions", [None, (math.nan,)])
def test_nothing_is_planned_from_an_unknown_position(
    bench: Any, joints: Any, path: str, body: str, positions: Any
) -> None:
    """Before the first frame, and if a frame contains NaN."""
    bench.robot(joints, positions)
    with pytest.raises(Conflict, match="unknown"):
        bench.plan(path, body)


# -- robot ----------------------------------------------------------------------------------------------------------


def test_joints_move_together_each_in_its_unit(bench: Any) -> None:
    """moveJoints: one command for all of them, with the share of speed and the client's preconditions, in SI units."""
    bench.robot({**_ELBOW, **_LIFT, **_WHEEL}, (0.0, 0.0, 6.0))
    expects = "lf:precondition [ lf:ofJoint </r/lift> ; vom:numericalValue 10 ; vom:unit unit:MilliM ; lf:tolerance 2 ]"
    targets = [_target("elbow", 90, "unit:DEG"), _target("lift", 20, "unit:MilliM"), _target("wheel", 0)]
    plan = bench.plan("/r/actions/moveJoints", f"<> {' ; '.join(targets)} ; lf:speedScale 0.25 ; {expects} .")
    assert plan.targets == {
        "elbow": pytest.approx(math.pi / 2),
        "lift": pytest.approx(0.02),
        "wheel": pytest.approx(2 * math.pi),
    }
    assert plan.motion == Move(plan.targets)
    assert plan.speed_scale == 0.25
    assert plan.expectations == {"lift": Expectation(pytest.approx(0.01), pytest.approx(0.002))}
    assert not plan.tied_to_lease


def test_the_robots_own_share_of_speed_bounds_the_clients(bench: Any) -> None:
    """maximumSpeedScale applies to clients that state no speed, and to those that want more."""
    robot = bench.robot(_ELBOW)
    bench.fleet.configure("r", {"maximumSpeedScale": "0.5"})
    for said, scale in (("", 0.5), ("; lf:speedScale 0.9", 0.5), ("; lf:speedScale 0.1", 0.1)):
        assert bench.plan("/r/actions/moveJoints", f"<> {_target('elbow', 1)} {said} .").speed_scale == scale
    assert robot.speed_scale == 0.5


def test_a_motion_may_be_tied_to_the_lease_of_the_robot(bench: Any) -> None:
    """lf:tiedTo may only name the lease of this robot."""
    bench.robot(_ELBOW)
    assert bench.plan(
        "/r/elbow/actions/rotate", f"<> vom:numericalValue 1 ; {_RAD} ; lf:tiedTo </r/lease> ."
    ).tied_to_lease
    with pytest.raises(UnprocessableContent, match="tiedTo"):
        bench.plan("/r/elbow/actions/rotate", f"<> vom:numericalValue 1 ; {_RAD} ; lf:tiedTo </s/lease> .")


def test_one_joint_has_one_target(bench: Any) -> None:
    """Two targets of a joint, even equal ones, are an error of the client."""
    bench.robot(_ELBOW)
    with pytest.raises(UnprocessableContent, match="Two targets name elbow"):
        bench.plan("/r/actions/moveJoints", f"<> {_target('elbow', 1)} ; {_target('elbow', 0)} .")


def test_one_joint_is_expected_in_one_place(bench: Any) -> None:
    """One of two preconditions on a joint would be ignored."""
    bench.robot(_ELBOW)
    expects = "lf:precondition [ lf:ofJoint </r/elbow> ; vom:numericalValue {} ; vom:unit unit:RAD ; lf:tolerance 1 ]"
    with pytest.raises(UnprocessableContent, match="Two preconditions"):
        body = f"<> vom:numericalValue 1 ; {_RAD} ; {expects.format(0)} ; {expects.format(1)} ."
        bench.plan("/r/elbow/actions/rotate", body)


def test_waypoints_are_in_the_order_of_their_times(bench: Any) -> None:
    """In any order in the body; rows are in the order of the joints, the last row is the robot's end position."""
    bench.robot({**_ELBOW, **_LIFT})
    first = _waypoint(0.5, _target("elbow", 0.1), _target("lift", 0.01, "unit:M"))
    last = _waypoint(2, _target("lift", 20, "unit:MilliM"), _target("elbow", 1))
    plan = bench.plan("/r/actions/followTrajectory", f"<> {last} ; {first} .")
    assert isinstance(plan.motion, Follow)
    rows = [dict(zip(plan.motion.joints, row, strict=True)) for row in plan.motion.positions]
    assert plan.motion.times_s == (0.5, 2.0)
    assert rows == [
        {"elbow": pytest.approx(0.1), "lift": pytest.approx(0.01)},
        {"elbow": pytest.approx(1.0), "lift": pytest.approx(0.02)},
    ]
    assert plan.targets == rows[-1]


def test_continuous_joints_go_on_from_waypoint_to_waypoint(bench: Any) -> None:
    """0°, 120°, 240°, 0° of a wheel at 720° is one turn forward and not a turn back."""
    bench.robot(_WHEEL, (4 * math.pi,))
    waypoints = [_waypoint(t, _target("wheel", angle, "unit:DEG")) for t, angle in ((1, 0), (2, 120), (3, 240), (4, 0))]
    plan = bench.plan("/r/actions/followTrajectory", f"<> {' ; '.join(waypoints)} .")
    turns = [row[0] / (2 * math.pi) for row in plan.motion.positions]
    assert turns == pytest.approx([2, 2 + 1 / 3, 2 + 2 / 3, 3])


@pytest.mark.parametrize(
    ("waypoints", "said"),
    [
        ([_waypoint(1, _target("elbow", 0)), _waypoint(1.0, _target("elbow", 1))], "same lf:atTime"),
        ([_waypoint(1, _target("elbow", 0)), _waypoint(2, _target("lift", 0, "unit:M"))], "other joints"),
        (
            [_waypoint(1, _target("elbow", 0)), _waypoint(2, _target("elbow", 0), _target("lift", 0, "unit:M"))],
            "other joints",
        ),
        ([_waypoint(1, _target("elbow", 0), _target("elbow", 1))], "Two targets name elbow"),
    ],
)
def test_trajectories_that_contradict_themselves(bench: Any, waypoints: list[str], said: str) -> None:
    """Contradictions that no shape can express are reported by the handler, also as a 422."""
    bench.robot({**_ELBOW, **_LIFT})
    with pytest.raises(UnprocessableContent, match=said):
        bench.plan("/r/actions/followTrajectory", f"<> {' ; '.join(waypoints)} .")


def test_a_pose_is_assumed_by_name(bench: Any) -> None:
    """All of its joints at once; a continuous one goes the short way."""
    pose = '<> lf:namedPose [ dcterms:title "up" ; {} ; {} ] .'.format(
        "lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 90 ; vom:unit unit:DEG ]",
        "lf:target [ lf:ofJoint <wheel> ; vom:numericalValue 0 ; vom:unit unit:RAD ]",
    )
    bench.robot({**_ELBOW, **_WHEEL}, (0.0, 6.0), annotations=pose)
    plan = bench.plan("/r/actions/assumePose", '<> lf:poseName "up" .')
    assert plan.targets == {"elbow": pytest.approx(math.pi / 2), "wheel": pytest.approx(2 * math.pi)}
    with pytest.raises(UnprocessableContent, match="pose: 'down'"):
        bench.plan("/r/actions/assumePose", '<> lf:poseName "down" .')


def test_halts_say_whom_they_stop(bench: Any) -> None:
    """A joint, a robot, or all robots; also a robot with an unknown position."""
    bench.robot(_ELBOW, None)
    assert bench.plan("/r/elbow/actions/hold") == Halt(("r",), ("elbow",))
    assert bench.plan("/r/actions/stop") == Halt(("r",))
    assert bench.plan("/actions/stopAll") == Halt(None)
