"""Impossible or rehearsed motions move nothing: no setpoint in the simulator changes at all."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import rdflib
from rdflib import URIRef

from browser import LF, VOM
from commands import Commanded, pose_body, scalar
from running import eventually
from simulated_robots import SimulatedRobot, simulated
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

# A joint of the arm and one of the torso, with which every rehearsed action is concerned.
ARM, TORSO = "arm_1_joint", "torso_lift_joint"
STILL_RAD = 1e-5
Bodies = dict[URIRef, tuple[str, Callable[[Commanded, SimulatedRobot], str]]]


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SimulatedRobot, Commanded]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), simulated(place.zenoh, "tiago") as robots:
        live(browser, "tiago")
        yield robots["tiago"], Commanded(browser, "tiago")


@pytest.fixture
def robot(both: tuple[SimulatedRobot, Commanded]) -> Iterator[SimulatedRobot]:
    """Yield the robot at home and at rest."""
    simulation, client = both
    client.assume("home")
    eventually(lambda: simulation.speed() < 1e-7, "the servos settled")
    simulation.watch()
    yield simulation
    simulation.check_limits()


@pytest.fixture
def client(both: tuple[SimulatedRobot, Commanded]) -> Commanded:
    return both[1]


def _reachable(client: Commanded, robot: SimulatedRobot) -> str:
    home = robot.poses["home"]
    wanted, turned = robot.pose("arm_tool_link", home | {ARM: 0.7, TORSO: 0.17, "arm_4_joint": 1.0})
    return pose_body(client.links["arm_tool_link"], wanted, turned)


# By kind of action: the joint that has it, if any, and a body that would move ARM or TORSO.
MOTIONS: Bodies = {
    LF.Rotate: (ARM, lambda client, robot: scalar(1.0)),
    LF.RotateBy: (ARM, lambda client, robot: scalar(0.3)),
    LF.Translate: (TORSO, lambda client, robot: scalar(100, "unit:MilliM")),
    LF.TranslateBy: (TORSO, lambda client, robot: scalar(-20, "unit:MilliM")),
    LF.MoveJoints: ("", lambda client, robot: f"<> {client.targets({ARM: 1.0})} ."),
    LF.FollowTrajectory: ("", lambda client, robot: client.waypoints({2.0: {ARM: 0.6}, 4.0: {ARM: 0.9}})),
    LF.Reach: ("", _reachable),
    LF.AssumePose: ("", lambda client, robot: '<> lf:poseName "folded" .'),
}
STOPS: Bodies = {
    LF.Hold: (ARM, lambda client, robot: ""),
    LF.StopRobot: ("", lambda client, robot: ""),
}


def _rehearse(client: Commanded, robot: SimulatedRobot, kind: URIRef, bodies: Bodies) -> rdflib.Graph:
    joint, body = bodies[kind]
    answer = client.ask(kind, body(client, robot), joint, prefer="dry-run")
    assert (answer.status_code, answer.headers["preference-applied"]) == (200, "dry-run"), answer.text
    assert "location" not in answer.headers
    return rdflib.Graph().parse(data=answer.text, format="turtle")


def _scalar(graph: rdflib.Graph, predicate: URIRef) -> float:
    (node,) = graph.objects(None, predicate)
    return float(str(graph.value(node, VOM.numericalValue)))


def _invocations(client: Commanded, kind: URIRef, joint: str) -> str:
    action = client.browser.page(client.action(kind, joint))
    return client.browser.page(str(action.one(LF.invocations))).response.text


@pytest.mark.parametrize("kind", MOTIONS, ids=lambda kind: kind.rpartition("#")[2])
def test_rehearsal_says_how_long_it_would_take_and_moves_nothing(
    robot: SimulatedRobot, client: Commanded, kind: URIRef
) -> None:
    """Setpoints and positions stay, and no invocation is stored."""
    before, invocations = robot.positions(), _invocations(client, kind, MOTIONS[kind][0])
    setpoints = robot.setpoints()
    graph = _rehearse(client, robot, kind, MOTIONS)
    assert (None, rdflib.RDF.type, LF.Rehearsal) in graph
    assert _scalar(graph, LF.duration) > 0
    assert not set(graph.objects(None, LF.preempts))
    robot.watch()
    eventually(lambda: len(robot.steps) > 100, "the simulation going on")
    assert robot.setpoints() == setpoints
    assert robot.positions() == pytest.approx(before, abs=STILL_RAD)
    assert _invocations(client, kind, MOTIONS[kind][0]) == invocations


def test_rehearsal_tells_the_truth(robot: SimulatedRobot, client: Commanded) -> None:
    """The real motion takes the announced time, and ends at the announced position."""
    joint, body = MOTIONS[LF.Rotate]
    graph = _rehearse(client, robot, LF.Rotate, MOTIONS)
    (target,) = graph.objects(None, LF.target)
    said = float(str(graph.value(graph.value(target, LF.value), VOM.numericalValue)))
    done = client.do(LF.Rotate, body(client, robot), joint)
    assert _scalar(done.graph, LF.duration) == pytest.approx(_scalar(graph, LF.duration), abs=0.002)
    assert robot.positions()[joint] == pytest.approx(said, abs=1e-3)


@pytest.mark.parametrize("kind", MOTIONS | STOPS, ids=lambda kind: kind.rpartition("#")[2])
def test_rehearsal_lists_what_it_would_end_and_ends_nothing(
    robot: SimulatedRobot, client: Commanded, kind: URIRef
) -> None:
    """A slow motion of torso and arm continues undisturbed."""
    slow = f"<> {client.targets({ARM: 2.0, TORSO: 0.3}, robot.linear)} ; lf:speedScale 0.05 ."
    running = client.begin(LF.MoveJoints, slow)
    eventually(lambda: robot.speed() > 0.02, "a motion under way")
    graph = _rehearse(client, robot, kind, MOTIONS | STOPS)
    assert [str(each) for each in graph.objects(None, LF.preempts)] == [running]
    assert _scalar(graph, LF.duration) > 0
    at = robot.positions()[ARM]
    eventually(lambda: robot.positions()[ARM] > at + 0.01, "the motion going on")
    assert client.browser.page(running).one(LF.state) == LF.running
    client.do(LF.StopRobot)


def _nearest_m(robot: SimulatedRobot, link: str, point: np.ndarray) -> float:
    """Return the smallest distance of a link to a point, over a thousand joint positions."""
    random = np.random.default_rng(1)
    ranges = {
        name: (joint.limits.lower, joint.limits.upper)
        for name, joint in robot.joints.items()
        if name.startswith(("arm_", "torso_")) and None not in (joint.limits.lower, joint.limits.upper)
    }
    places = ({name: random.uniform(*ends) for name, ends in ranges.items()} for _ in range(1000))
    return min(float(np.linalg.norm(robot.pose(link, place)[0] - point)) for place in places)


def test_unreachable_position_is_refused_with_how_near_the_link_would_come(
    robot: SimulatedRobot, client: Commanded
) -> None:
    """The residual is that of the nearest of a thousand positions, or up to 50 mm better."""
    setpoints, before = robot.setpoints(), robot.positions()
    point, link = np.array([2.5, 0.5, 0.8]), "arm_tool_link"
    answer = client.ask(LF.Reach, pose_body(client.links[link], point))
    assert answer.status_code == 422, answer.text
    problem = answer.json()
    assert problem["type"].endswith("#out-of-reach")
    assert problem["residual_rad"] == 0.0
    nearest_m = _nearest_m(robot, link, point)
    assert nearest_m - 0.05 <= problem["residual_m"] <= nearest_m
    robot.watch()
    eventually(lambda: len(robot.steps) > 100, "the simulation going on")
    assert robot.setpoints() == setpoints
    assert robot.positions() == pytest.approx(before, abs=STILL_RAD)


def test_unreachable_orientation_is_refused_with_the_angle_that_is_left(
    robot: SimulatedRobot, client: Commanded
) -> None:
    """The head pans and tilts, but never rolls: a quarter turn about its own axis is unreachable by just that angle."""
    setpoints = robot.setpoints()
    position, (x, y, z, w) = robot.pose("head_2_link")
    half = math.sqrt(0.5)
    # The present orientation times a quarter turn about x, which points ahead.
    turned = (half * (w + x), half * (y + z), half * (z - y), half * (w - x))
    answer = client.ask(LF.Reach, pose_body(client.links["head_2_link"], position, turned))
    assert answer.status_code == 422, answer.text
    assert answer.json()["type"].endswith("#out-of-reach")
    assert answer.json()["residual_rad"] == pytest.approx(math.pi / 2, abs=1e-3)
    assert answer.json()["residual_m"] < 1e-4
    assert robot.setpoints() == setpoints


def test_refused_motion_moves_nothing(robot: SimulatedRobot, client: Commanded) -> None:
    """A path that is too fast gets 409 with the factor for its times, with which it is accepted."""
    setpoints = robot.setpoints()
    answer = client.ask(LF.FollowTrajectory, client.waypoints({0.1: {ARM: 0.7}, 0.2: {ARM: 0.9}}))
    assert (answer.status_code, "stretch all times" in answer.json()["detail"]) == (409, True)
    assert robot.setpoints() == setpoints
    factor = float(answer.json()["detail"].rpartition("factor of ")[2])
    client.do(LF.FollowTrajectory, client.waypoints({0.1 * factor: {ARM: 0.7}, 0.2 * factor: {ARM: 0.9}}))
    assert robot.positions()[ARM] == pytest.approx(0.9, abs=1e-3)
