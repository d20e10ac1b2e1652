"""Motions of single and several joints, observed in the simulator."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from rdflib import URIRef

from browser import LF
from commands import Commanded, scalar
from running import eventually
from simulated_robots import RESTING_RAD_S, SimulatedRobot, simulated
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

CLOSE_M, CLOSE_RAD = 1e-3, math.radians(0.5)
# Joints with the same completed share at any time differ only by the lag of their servos.
TOGETHER_S = 0.05
_SHARES = (0.25, 0.5, 0.75, 0.95)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, tuple[SimulatedRobot, Commanded]]]:
    """TIAGo, with revolute and prismatic joints; UR5, whose joints have no friction; and one that turns endlessly."""
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), simulated(place.zenoh, "tiago", "ur5", "turntable") as robots:
        yield {name: (robot, Commanded(browser, name)) for name, robot in robots.items() if live(browser, name)}


@pytest.fixture
def name() -> str:
    """Return the default robot of a test."""
    return "tiago"


@pytest.fixture
def robot(both: dict[str, tuple[SimulatedRobot, Commanded]], name: str) -> Iterator[SimulatedRobot]:
    """Yield the robot at home; the test fails if a limit of its URDF is exceeded."""
    simulation, client = both[name]
    if simulation.poses:
        client.assume("home")
    simulation.watch()
    yield simulation
    simulation.check_limits()


@pytest.fixture
def client(both: dict[str, tuple[SimulatedRobot, Commanded]], name: str) -> Commanded:
    return both[name][1]


def test_assume_pose_home_is_where_the_robot_began(robot: SimulatedRobot, client: Commanded) -> None:
    client.do(LF.MoveJoints, f"<> {client.targets({'arm_1_joint': 0.9, 'head_1_joint': -0.4})} .")
    client.assume("home")
    measured = robot.positions()
    assert {name: measured[name] for name in robot.poses["home"]} == pytest.approx(robot.poses["home"], abs=CLOSE_M)


@pytest.mark.parametrize(("by", "unit"), [(20.0, "unit:DEG"), (-0.2, "maths:Radian")])
def test_rotate_by_turns_from_where_the_joint_is(
    robot: SimulatedRobot, client: Commanded, by: float, unit: str
) -> None:
    """Twice is twice as far."""
    start, way = robot.positions()["arm_1_joint"], math.radians(by) if unit == "unit:DEG" else by
    for times in (1, 2):
        client.do(LF.RotateBy, scalar(by, unit), "arm_1_joint")
        assert robot.positions()["arm_1_joint"] == pytest.approx(start + times * way, abs=CLOSE_RAD)


@pytest.mark.parametrize(("by", "unit"), [(-30, "unit:MilliM"), (0.02, "unit:M")])
def test_translate_by_slides_from_where_the_joint_is(
    robot: SimulatedRobot, client: Commanded, by: float, unit: str
) -> None:
    start, way = robot.positions()["torso_lift_joint"], by / 1000 if unit == "unit:MilliM" else by
    client.do(LF.TranslateBy, scalar(by, unit), "torso_lift_joint")
    assert robot.positions()["torso_lift_joint"] == pytest.approx(start + way, abs=CLOSE_M)


def test_translate_goes_to_an_absolute_position(robot: SimulatedRobot, client: Commanded) -> None:
    for value, unit in ((120, "unit:MilliM"), (0.16, "unit:M")):
        client.do(LF.Translate, scalar(value, unit), "torso_lift_joint")
        metre = value / 1000 if unit == "unit:MilliM" else value
        assert robot.positions()["torso_lift_joint"] == pytest.approx(metre, abs=CLOSE_M)


@pytest.mark.parametrize(
    ("value", "unit"),
    [
        (40, "maths:Degree"),
        (41, "vom:Degree"),
        (42, "unit:DEG"),
        (0.6, "maths:Radian"),
        (0.61, "vom:Radian"),
        (0.62, "unit:RAD"),
    ],
)
def test_rotate_understands_every_unit(robot: SimulatedRobot, client: Commanded, value: float, unit: str) -> None:
    """Degree and radian of the VOM, of its maths vocabulary and of QUDT."""
    client.do(LF.Rotate, scalar(value, unit), "arm_1_joint")
    radian = math.radians(value) if value > 2 else value
    assert robot.positions()["arm_1_joint"] == pytest.approx(radian, abs=CLOSE_RAD)


@pytest.mark.parametrize(
    ("name", "kind", "joint", "by", "speed", "si"),
    [
        ("ur5", LF.RotateBy, "shoulder_pan_joint", 0.4, "15 ; vom:unit unit:DEG-PER-SEC", math.radians(15)),
        ("ur5", LF.Rotate, "wrist_3_joint", 0.4, "0.3 ; vom:unit unit:RAD-PER-SEC", 0.3),
        ("tiago", LF.RotateBy, "arm_1_joint", 0.4, "0.3 ; vom:unit unit:RAD-PER-SEC", 0.3),
        ("tiago", LF.TranslateBy, "torso_lift_joint", -0.03, "20 ; vom:unit unit:MilliM-PER-SEC", 0.02),
    ],
)
def test_optional_speed_is_reached_and_not_exceeded(
    robot: SimulatedRobot, client: Commanded, kind: URIRef, joint: str, by: float, speed: str, si: float
) -> None:
    """The joint is never faster, ripple included, and not much slower."""
    unit = "unit:M" if joint in robot.linear else "unit:RAD"
    client.do(kind, scalar(by, unit, f"lf:speed [ vom:numericalValue {speed} ]"), joint)
    _, speeds = robot.seen(joint, "velocities")
    assert 0.85 * si <= np.abs(speeds).max() <= si


@pytest.mark.parametrize("name", ["ur5"])
def test_speed_scale_slows_all_joints_down(robot: SimulatedRobot, client: Commanded) -> None:
    ways, fastest = {"shoulder_pan_joint": 1.4, "wrist_3_joint": 0.7}, []
    for scale in (1.0, 0.5):
        client.assume("home")
        robot.watch()
        client.do(LF.MoveJoints, f"<> {client.targets(ways)} ; lf:speedScale {scale} .")
        fastest.append([np.abs(robot.seen(joint, "velocities")[1]).max() for joint in ways])
    assert fastest[1] == pytest.approx([speed / 2 for speed in fastest[0]], rel=0.03)


def test_hold_stops_the_joint_where_it_is(robot: SimulatedRobot, client: Commanded) -> None:
    slowly = "lf:speed [ vom:numericalValue 0.3 ; vom:unit unit:RAD-PER-SEC ]"
    motion = client.begin(LF.Rotate, scalar(2.0, more=slowly), "arm_1_joint")
    eventually(lambda: robot.positions()["arm_1_joint"] > 0.6, "a motion under way")
    hold = client.do(LF.Hold, joint="arm_1_joint")
    rested = robot.positions()["arm_1_joint"]
    assert robot.speed() <= RESTING_RAD_S
    assert rested < 1.9
    page = client.browser.page(motion)
    assert (page.one(LF.state), page.one(LF.preemptedBy)) == (LF.cancelled, hold.iri)
    robot.watch()
    eventually(lambda: len(robot.steps) > 400, "the simulation going on")
    assert robot.positions()["arm_1_joint"] == pytest.approx(rested, abs=1e-3)


@pytest.mark.parametrize("name", ["turntable"])
def test_continuous_joint_goes_the_short_way(robot: SimulatedRobot, client: Commanded) -> None:
    """Across zero, and across half a turn, never in the other direction."""
    here = robot.positions()["turn"]
    for degree in (350, 190, 100, 10):
        robot.watch()
        client.do(LF.Rotate, scalar(degree, "maths:Degree"), "turn")
        there = robot.positions()["turn"]
        assert math.remainder(there - math.radians(degree), math.tau) == pytest.approx(0.0, abs=CLOSE_RAD)
        _, positions = robot.seen("turn")
        assert np.ptp(positions) <= abs(math.remainder(math.radians(degree) - here, math.tau)) + 2 * CLOSE_RAD
        here = there


def _passing(robot: SimulatedRobot, joint: str, start: float, end: float) -> list[float]:
    """Return the times at which the joint had completed each of the shares."""
    times, positions = robot.seen(joint)
    done = (positions - start) / (end - start)
    return [float(times[np.argmax(done >= share)]) for share in _SHARES]


def _check_together(robot: SimulatedRobot, client: Commanded, ends: dict[str, float]) -> None:
    start = robot.positions()
    client.do(LF.MoveJoints, f"<> {client.targets(ends, robot.linear)} .")
    passing = [_passing(robot, joint, start[joint], end) for joint, end in ends.items()]
    for share, times in zip(_SHARES, zip(*passing, strict=True), strict=True):
        assert max(times) - min(times) <= TOGETHER_S, share
    measured = robot.positions()
    for joint, end in ends.items():
        assert abs(measured[joint] - end) <= (CLOSE_M if joint in robot.linear else CLOSE_RAD), joint


def test_move_joints_arrive_together(robot: SimulatedRobot, client: Commanded) -> None:
    """Whatever the distances, all joints have completed the same share at any time, within five ticks."""
    _check_together(robot, client, {"arm_1_joint": 1.3, "arm_2_joint": -0.2, "arm_4_joint": 1.0, "head_1_joint": 0.2})


def test_joints_that_slide_arrive_together_with_those_that_turn(robot: SimulatedRobot, client: Commanded) -> None:
    """TIAGo's torso, whose guide damps it more than its servo does."""
    _check_together(robot, client, {"arm_1_joint": 1.3, "head_1_joint": 0.2, "torso_lift_joint": 0.22})


def test_move_joints_put_again_moves_nothing(robot: SimulatedRobot, client: Commanded) -> None:
    """PUT is idempotent: the second one succeeds as well, and no joint moves more than the servos settle."""
    body = f"<> {client.targets({'arm_1_joint': 0.8, 'head_1_joint': 0.3})} ."
    client.do(LF.MoveJoints, body, method="PUT")
    robot.watch()
    client.do(LF.MoveJoints, body, method="PUT")
    for joint in robot.joints:
        assert np.ptp(robot.seen(joint)[1]) < 5e-4, joint


def test_json_ld_moves_joints_and_what_no_shape_covers_is_ignored(robot: SimulatedRobot, client: Commanded) -> None:
    """Other types and predicates, at the root and below, of an unknown vocabulary."""
    body = {
        "@context": ["https://w3id.org/linked-fleet/context", {"ex": "http://example.org/"}],
        "@id": "",
        "@type": "ex:Wish",
        "ex:urgency": 3,
        "lf:target": {
            "lf:ofJoint": {"@id": client.joints["arm_1_joint"]},
            "vom:numericalValue": 50,
            "vom:unit": {"@id": "unit:DEG"},
            "ex:why": {"ex:because": "it is in the way"},
        },
    }
    url, sent = client.action(LF.MoveJoints), {"content-type": "application/ld+json", "prefer": "wait=60"}
    answer = client.browser.http.post(url, json=body, headers=sent, timeout=90)
    assert answer.status_code == 204, answer.text
    assert robot.positions()["arm_1_joint"] == pytest.approx(math.radians(50), abs=CLOSE_RAD)
