"""A ROS 2 robot in a fleet: through agent and gateway it is browsed, read and moved, until it falls silent."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from browser import LF, ROS, SPATIAL, Browser
from ros2_robot import RosRobot
from running import Process, eventually, free_port, process
from small_fleet import Place, faulty, live, move, number, property_page

pytestmark = pytest.mark.processes

Scene = tuple[Browser, RosRobot, Process]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    place = Place(tmp_path_factory.mktemp("ros2"))
    with ExitStack() as stack:
        robot = stack.enter_context(RosRobot(f"tcp/127.0.0.1:{free_port()}"))
        _, browser = stack.enter_context(place.gateway())
        source = f"--robot=arm=ros2:{robot.endpoint}?stale=3"
        agent = stack.enter_context(process("-m", "linked_fleet_agent", source, "--connect", place.zenoh))
        live(browser, "arm")
        yield browser, robot, agent


def test_a_ros_robot_is_served_as_resources(scene: Scene) -> None:
    browser, _, _ = scene
    page = browser.robot("arm")
    assert "ros2" not in str(page.response.text)  # its address would reveal the robot's own network
    assert number(property_page(browser, "arm", "pan", ROS.rotation), SPATIAL.rotationAngle) == pytest.approx(0.25)
    lift = property_page(browser, "arm", "lift", LF.translation)
    assert "0.1" in lift.response.text
    effort = property_page(browser, "arm", "pan", LF.effort)
    assert LF.unknown in set(effort.graph.objects())


def test_a_ros_robot_moves_and_is_faulty_without_states(scene: Scene) -> None:
    browser, robot, agent = scene
    rotate = browser.action(browser.part("arm", "pan"), LF.Rotate)
    assert move(browser, rotate, 0.75, Prefer="respond-async").status_code in (201, 202, 204)
    eventually(lambda: abs(robot.positions["pan"] - 0.75) < 1e-3, "it is moved")
    eventually(lambda: abs(_pan(browser) - 0.75) < 1e-3, "and that is seen")
    assert robot.refused == 0
    assert robot.positions["lift"] == 0.1 and robot.positions["grip"] == 0.5

    robot.fall_silent()
    agent.said("no joint state of this robot came on /joint_states for 3 s")
    eventually(lambda: _pan(browser) == LF.unknown, "its values are unknown")
    answer = move(browser, rotate, 0.5)
    assert answer.status_code in (409, 503), answer.text
    assert "no joint state" in answer.text
    assert "Traceback" not in agent.output.partition("no joint state")[0]


def test_a_robot_that_boots_after_its_agent_comes_online_by_itself(tmp_path: Path) -> None:
    """Meanwhile the agent waits, as a unit of systemd lets it, and gateways show what is missing."""
    place, endpoint = Place(tmp_path), f"tcp/127.0.0.1:{free_port()}"
    source = f"--robot=arm=ros2:{endpoint}"
    with (
        place.gateway() as (_, browser),
        process("-m", "linked_fleet_agent", source, "--connect", place.zenoh) as agent,
    ):
        agent.said("the robot is tried again in 2 s")
        assert faulty(browser, "arm")
        with RosRobot(endpoint):
            live(browser, "arm")
            assert agent.stop() == 0


def _pan(browser: Browser) -> float:
    return number(property_page(browser, "arm", "pan", ROS.rotation), SPATIAL.rotationAngle)
