"""The demonstration robots execute HTTP commands in MuJoCo; their URDF limits hold in every step.

Motions are observed in the simulator's own state, by the clock of the simulation.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from rdflib import URIRef

from browser import DCTERMS, LF, PROV, Browser
from commands import Commanded, pose_body
from running import eventually
from simulated_robots import RESTING_RAD_S, SimulatedRobot, angle_between, simulated
from small_fleet import Place, live, number

pytestmark = pytest.mark.virtual

CLOSE_M, CLOSE_RAD = 1e-3, np.radians(0.5)
# Permitted delay at a waypoint: the lag of the servos (40 ms) and a tick.
LATE_S = 0.06
# A link of each robot, and joint motions from home that bring it to a reachable pose.
GOALS = {
    "baxter": (
        "right_gripper",
        {"right_s0": 0.3, "right_s1": -0.2, "right_e0": 0.3, "right_e1": 0.25, "right_w1": -0.3, "right_w2": 0.5},
    ),
    "ur5": (
        "tool0",
        {"shoulder_pan_joint": 0.6, "shoulder_lift_joint": 0.2, "elbow_joint": -0.3, "wrist_3_joint": 0.8},
    ),
    "panda": (
        "panda_hand",
        {"panda_joint1": -0.5, "panda_joint2": 0.3, "panda_joint4": 0.3, "panda_joint5": 0.3, "panda_joint7": -0.4},
    ),
    "tiago": (
        "arm_tool_link",
        {"torso_lift_joint": 0.03, "arm_1_joint": 0.3, "arm_2_joint": 0.2, "arm_4_joint": -0.3, "arm_6_joint": 0.4},
    ),
    "go2": ("FL_foot", {"FL_hip_joint": 0.02, "FL_thigh_joint": 0.05, "FL_calf_joint": -0.12}),
}
# A pose that involves all or most joints of a robot.
POSES = {"baxter": "untucked", "ur5": "upright", "panda": "upright", "tiago": "folded", "go2": "crouched"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Place, Browser]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser):
        yield place, browser


@pytest.fixture(scope="module", params=sorted(GOALS))
def both(request: pytest.FixtureRequest, place: tuple[Place, Browser]) -> Iterator[tuple[SimulatedRobot, Commanded]]:
    """Yield one robot, as seen by the simulator and by the client."""
    there, browser = place
    with simulated(there.zenoh, request.param) as robots:
        live(browser, request.param)
        yield robots[request.param], Commanded(browser, request.param)


@pytest.fixture
def robot(both: tuple[SimulatedRobot, Commanded]) -> Iterator[SimulatedRobot]:
    """Yield the robot at home; the test fails if a limit of its URDF is exceeded, or if it falls."""
    simulation, client = both
    client.assume("home")
    simulation.watch()
    yield simulation
    simulation.check_limits()
    assert simulation.upright() > 0.99


@pytest.fixture
def client(both: tuple[SimulatedRobot, Commanded]) -> Commanded:
    return both[1]


def _close(robot: SimulatedRobot, joint: str) -> float:
    return CLOSE_M if robot.joints[joint].linear else CLOSE_RAD


def test_reach_brings_the_link_to_the_pose(robot: SimulatedRobot, client: Commanded) -> None:
    """Within 1 mm and 0.5° of the commanded pose in the frame of the root link; for go2, which stands on it, a foot."""
    link, offsets = GOALS[robot.name]
    home = robot.poses["home"]
    wanted, turned = robot.pose(link, {name: home[name] + by for name, by in offsets.items()})
    assert np.linalg.norm(wanted - robot.pose(link)[0]) > 0.01
    asked = pose_body(client.links[link], wanted, None if robot.name == "go2" else turned)
    invocation = client.do(LF.Reach, asked)
    assert number(invocation, LF.positionResidual) <= CLOSE_M
    reached, orientation = robot.pose(link)
    assert np.linalg.norm(reached - wanted) <= CLOSE_M
    if robot.name != "go2":
        assert angle_between(orientation, turned) <= CLOSE_RAD


def test_at_full_speed_the_limits_of_the_urdf_hold(robot: SimulatedRobot, client: Commanded) -> None:
    """Velocity and effort of every joint in every step, there and back as fast as the robot goes."""
    for pose in (POSES[robot.name], "home"):
        client.assume(pose)
        measured = robot.positions()
        for joint, end in robot.poses[pose].items():
            assert abs(measured[joint] - end) <= _close(robot, joint), joint
    robot.check_limits()
    assert max(np.abs(robot.seen(joint, "velocities")[1]).max() for joint in robot.joints) > 0.7


def _between(robot: SimulatedRobot, share: float) -> dict[str, float]:
    """Return the joint positions after that share of the way from home to the other pose."""
    home, there = robot.poses["home"], robot.poses[POSES[robot.name]]
    return {name: home[name] + share * (there[name] - home[name]) for name in there if there[name] != home[name]}


def test_follow_trajectory_passes_the_waypoints_at_their_times(robot: SimulatedRobot, client: Commanded) -> None:
    """Each joint within 1 mm or 0.5° of the middle waypoint, 60 ms late at most, and of the last one at the end."""
    rows = {3.0: _between(robot, 0.4), 5.5: _between(robot, 0.8)}
    client.do(LF.FollowTrajectory, client.waypoints(rows, robot.linear))
    began_s, measured = robot.accepted_s, robot.positions()
    for joint, last in rows[5.5].items():
        times, positions = robot.seen(joint)
        near = positions[(times >= began_s + 3.0 - LATE_S) & (times <= began_s + 3.0 + LATE_S)]
        assert np.abs(near - rows[3.0][joint]).min() <= _close(robot, joint), joint
        assert abs(measured[joint] - last) <= _close(robot, joint), joint
        assert all(later - earlier < 0.02 for earlier, later in pairwise(times)), "no step may be missing"


def test_stop_brings_the_robot_to_rest_on_its_way(robot: SimulatedRobot, client: Commanded) -> None:
    """All joints stand short of the target; the motion is cancelled with the reason and client, the stop succeeded."""
    target = robot.poses[POSES[robot.name]]
    start = robot.positions()
    motion = client.begin(LF.AssumePose, f'<> lf:poseName "{POSES[robot.name]}" ; lf:speedScale 0.4 .')
    eventually(lambda: any(abs(robot.positions()[j] - start[j]) > 0.05 for j in target), "a motion under way")
    stop = client.do(LF.StopRobot)
    assert robot.speed() <= RESTING_RAD_S
    rested = robot.positions()
    assert any(abs(rested[joint] - target[joint]) > 0.1 for joint in target)
    page = client.browser.page(motion)
    assert page.one(LF.state) == LF.cancelled
    assert page.one(LF.reason) == URIRef("stopped")
    assert page.one(LF.preemptedBy) == stop.iri
    assert (stop.iri, LF.preempts, page.iri) in stop.graph
    who = stop.graph.value(stop.graph.value(stop.iri, PROV.wasAssociatedWith), DCTERMS.title)
    assert str(who) == "127.0.0.1"
    robot.watch()
    eventually(lambda: len(robot.steps) > 400, "the simulation going on")
    assert robot.positions() == pytest.approx(rested, abs=1e-3)
