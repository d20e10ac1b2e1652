"""The driver with a ROS 2 robot on loopback."""

import math
import re
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from certificates import made
from driver_contract import check_driver
from linked_fleet_agent.robot import RobotFaultError
from linked_fleet_agent.robots.catalogue import UnavailableError, load
from linked_fleet_agent.robots.ros2.address import AddressError, parse_address
from linked_fleet_agent.robots.ros2.robot import Ros2Robot
from ros2_robot import URDF, RosRobot
from running import eventually, free_port

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def find(robot: RosRobot, options: str = "?stale=10") -> Ros2Robot:
    return Ros2Robot.find("arm", parse_address(f"ros2:{robot.endpoint}{options}"))


@pytest.fixture(scope="module")
def robot() -> Iterator[RosRobot]:
    with RosRobot(endpoint()) as robot:
        yield robot


@pytest.fixture
def driver(robot: RosRobot) -> Iterator[Ros2Robot]:
    driver = find(robot)
    yield driver
    driver.close()


def test_the_ros_driver_fulfils_the_driver_contract(robot: RosRobot) -> None:
    check_driver(find(robot), lambda now_s: time.sleep(0.01), tolerance=1e-3, settle_s=0.4)
    assert robot.refused == 0


def test_the_ros_driver_finds_and_reads_a_robot(robot: RosRobot, driver: Ros2Robot) -> None:
    facts = driver.describe()
    assert (facts.title, facts.urdf) == ("Stand-in", URDF)
    assert [joint.name for joint in facts.joints] == ["pan", "lift", "grip", "thumb_grip"]
    reading = driver.read(0.0)
    assert reading.positions == pytest.approx([*robot.positions.values(), robot.positions["grip"]])
    assert reading.velocities == (0.0,) * 4
    assert all(math.isnan(effort) for effort in reading.efforts)


def test_ros_sees_a_node_that_listens_and_publishes(robot: RosRobot, driver: Ros2Robot) -> None:
    said = eventually(lambda: [token for token in robot.tokens() if "linked_fleet_agent" in token], "tokens")
    session = r"@ros2_lv/0/[0-9a-f]+/0"
    hashes = "RIHS01_[0-9a-f]{64}"
    node = "%/%/linked_fleet_agent"
    wanted = (
        rf"{session}/\d/NN/{node}",
        rf"{session}/\d/MS/{node}/%robot_description/std_msgs::msg::dds_::String_/{hashes}/:1:,1:,:,:,,",
        rf"{session}/\d/MS/{node}/%joint_states/sensor_msgs::msg::dds_::JointState_/{hashes}/::,1:,:,:,,",
        rf"{session}/\d/MP/{node}/%joint_trajectory_controller%joint_trajectory"
        rf"/trajectory_msgs::msg::dds_::JointTrajectory_/{hashes}/::,1:,:,:,,",
    )
    assert len(said) == 4
    assert all(any(re.fullmatch(each, token) for token in said) for each in wanted), said


def test_a_joint_outside_its_limits_is_not_sent_further_out_than_it_stands() -> None:
    """A setpoint where it stands is sent, so that it can be moved back from there."""
    with RosRobot(endpoint()) as robot, closing(find(robot)) as driver:
        upper = driver.describe().joints[1].limits.upper
        assert upper is not None
        robot.place("lift", upper + 0.2)
        eventually(lambda: driver.read(0.0).positions[1] == upper + 0.2, "it was moved by others")
        for asked in (upper + 0.2, upper + 0.3):
            assert driver.apply({"lift": asked}) == {"lift": upper + 0.2}


def test_a_joint_at_an_unknown_position_is_kept_within_its_limits() -> None:
    """One that was outside them when it was last known is not sent further out."""
    with RosRobot(endpoint()) as robot, closing(find(robot, "?stale=0.3")) as driver:
        pan, lift = (joint.limits for joint in driver.describe().joints[:2])
        assert pan.lower is not None and pan.upper is not None and lift.upper is not None
        robot.place("lift", lift.upper + 0.2)
        outside = {"lift": lift.upper + 0.2}
        eventually(lambda: driver.read(0.0).positions[1] == outside["lift"], "it was moved by others")
        assert driver.apply(outside) == outside
        robot.fall_silent()
        eventually(lambda: _is_silent(driver), "the joint states are old")
        for asked, kept in ((1e6, pan.upper), (-1e6, pan.lower)):
            assert driver.apply({"pan": asked}) == {"pan": kept}
        assert driver.apply({"lift": 1e6}) == outside


def _is_silent(driver: Ros2Robot) -> bool:
    try:
        return math.isnan(driver.read(0.0).positions[0])
    except RobotFaultError:
        return True


def test_a_joint_state_that_is_too_long_is_counted(robot: RosRobot, driver: Ros2Robot) -> None:
    def counted() -> bool:
        robot.say(bytes(300_000))  # again and again: what congestion has dropped is not counted
        driver.read(0.0)
        return driver.bad_messages > 0

    eventually(counted, "it is counted")
    assert driver.read(0.0).positions[0] == robot.positions["pan"]


def test_a_controller_may_have_some_of_the_joints() -> None:
    options = "?domain=7&namespace=/left&stale=10&commands=joint_trajectory_controller/joint_trajectory:pan;lift"
    with RosRobot(endpoint(), domain=7, namespace="/left") as robot, closing(find(robot, options)) as driver:
        assert [joint.name for joint in driver.describe().joints if joint.passive] == ["grip"]
        with pytest.raises(KeyError, match="grip"):
            driver.apply({"grip": 0.1})
        assert driver.describe().coupled == (("pan", "lift"),)
        driver.apply({"lift": 0.2, "pan": 0.1})
        eventually(lambda: robot.heard, "a trajectory")
        assert robot.heard[-1].joint_names == ["pan", "lift"]


def test_a_robot_that_falls_silent_is_a_fault_and_cannot_be_held() -> None:
    with RosRobot(endpoint()) as robot, closing(find(robot, "?stale=0.1")) as driver:
        robot.fall_silent()

        def fault() -> str:
            try:
                driver.read(0.0)
            except RobotFaultError as error:
                return str(error)
            return ""

        assert eventually(fault, "a fault") == "no joint state of this robot came on /joint_states for 0.1 s"
        with pytest.raises(RobotFaultError, match=r"no joint position .* holds the last position that it was sent"):
            driver.stop()


def test_a_robot_that_was_away_is_found_again() -> None:
    at = endpoint()
    with RosRobot(at) as robot:
        driver = find(robot, "?stale=0.2")
    with closing(driver):

        def readable() -> bool:
            try:
                return driver.read(0.0).positions[0] == 0.25
            except RobotFaultError:
                return False

        eventually(lambda: not readable(), "it is away")
        with RosRobot(at) as robot:
            eventually(readable, "it is read again")
            eventually(lambda: driver._ways[0][1].has_subscribers, "its controller")
            assert robot.heard == []  # and nothing moved because of that
            driver.apply({"pan": 0.3, "lift": 0.1, "grip": 0.5})
            eventually(lambda: robot.heard, "it has_options")


def test_without_a_controller_nothing_can_be_moved() -> None:
    with RosRobot(endpoint()) as robot, closing(find(robot)) as driver:
        driver.apply({"pan": 0.1})
        robot.leave_controller()

        def refusal() -> str:
            try:
                driver.apply({"pan": 0.2})
            except RobotFaultError as error:
                return str(error)
            return ""

        said = eventually(refusal, "the controller has gone")
        assert said == "no controller listens to /joint_trajectory_controller/joint_trajectory"
        assert driver.read(0.0).positions[1] == pytest.approx(0.1)


def test_a_router_may_demand_certificates(tmp_path: Path) -> None:
    folder = made(tmp_path / "ros", "--agent", "arm", "--router", "127.0.0.1")
    tls, known = f"tls/127.0.0.1:{free_port()}", f"root_ca_certificate_file={folder}/ca.pem;enable_mtls=true"
    listener = f"listen_certificate_file={folder}/router.pem;listen_private_key_file={folder}/router.key"
    proof = f"connect_certificate_file={folder}/agents/arm.pem;connect_private_key_file={folder}/agents/arm.key"
    with RosRobot(f"{tls}#{known};{listener}"):
        with closing(Ros2Robot.find("arm", parse_address(f"ros2:{tls}#{known};{proof}?stale=10"))) as driver:
            assert driver.read(0.0).positions[0] == 0.25
        with pytest.raises(ConnectionError):
            Ros2Robot.find("arm", parse_address(f"ros2:{tls}#root_ca_certificate_file={folder}/ca.pem"), 0.0)


def test_a_missing_topic_is_reported() -> None:
    nowhere = endpoint()
    with pytest.raises(ConnectionError):
        Ros2Robot.find("arm", parse_address(f"ros2:{nowhere}"), timeout_s=0.0)
    with RosRobot(endpoint(), urdf=None) as robot, pytest.raises(TimeoutError, match="/robot_description in domain 0"):
        Ros2Robot.find("arm", parse_address(f"ros2:{robot.endpoint}"), timeout_s=0.2)
    with RosRobot(endpoint(), urdf="<robot/>") as robot, pytest.raises(TimeoutError):
        Ros2Robot.find("arm", parse_address(f"ros2:{robot.endpoint}"), timeout_s=0.2)
    with RosRobot(endpoint()) as robot, pytest.raises(AddressError, match="thumb_grip"):
        find(robot, "?commands=a/b:pan;thumb_grip")
    with pytest.raises(UnavailableError, match="floating"):
        load("arm", "ros2:tcp/127.0.0.1:1", floating=True)
    with pytest.raises(UnavailableError, match="ros2:ENDPOINT"):
        load("arm", "ros2:127.0.0.1")
