"""Real robots of ROS 2 in a fleet, used by a client: what they are, services, goals with feedback, refusals, a stop."""

import asyncio
import re
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from connections import http_client
from linked_fleet_agent.robots.ros2.cdr import type_hash
from linked_fleet_agent.robots.ros2.goals import CANCELED, ActionClient
from linked_fleet_agent.robots.ros2.session import RosSession
from linked_fleet_agent.robots.ros2.types import MessageTypes
from linked_fleet_client.fleet import Fleet, Thing
from robot_client import await_angle, begin, end_of, joint_angle, state_of
from ros_peers import SOURCES, behind_bridge, on_humble, on_rmw_zenoh
from running import eventually, process
from small_fleet import Place

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

SIDES = {
    "rmw_zenoh": ("ros2", on_rmw_zenoh, "kilted"),
    "humble": ("ros2", on_humble, "humble"),
    "bridge": ("ros2dds", behind_bridge, "kilted"),
}
PAUSE_S = 0.2
FILE = """
[[property]]
topic = "lamp"

[[action]]
service = "set_lamp"

[[action]]
service = "home"
moves = ["pan", "lift"]

[[action]]
service = "silence"
duration_s = 1

[[action]]
action = "fibonacci"
"""


class Peer(NamedTuple):
    """A robot in its fleet, and the endpoint of ROS at which others reach it too."""

    thing: Thing
    endpoint: str


@pytest.fixture(scope="module", params=SIDES)
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Peer]:
    folder = tmp_path_factory.mktemp("fleet")
    with ExitStack() as stack:
        scheme, run, distro = SIDES[request.param]
        endpoint = stack.enter_context(run(PAUSE_S))
        place = Place(folder)
        stack.enter_context(place.gateway())
        stack.enter_context(agent(place, f"{scheme}:{endpoint}", distro, folder))
        fleet = stack.enter_context(Fleet(place.root))
        eventually(lambda: joint_angle(fleet, "arm/pan") is not None, "the position of a joint")
        yield Peer(fleet["arm"], endpoint)


@pytest.fixture
def arm(robot: Peer) -> Thing:
    """Return the robot."""
    return robot.thing


def agent(place: Place, address: str, distro: str, folder: Path) -> Any:
    (folder / "arm.toml").write_text(FILE)
    # Joint states of a busy machine may be a second late.
    options = f"stale=5&config={folder}/arm.toml&types={SOURCES}/interfaces_of_tests&distro={distro}"
    return process("-m", "linked_fleet_agent", f"--robot=arm={address}?{options}", "--connect", place.zenoh)


def test_battery_and_diagnostics_are_read(arm: Thing) -> None:
    eventually(lambda: arm["battery"].properties["charge"].value.number == 75.0, "the charge")
    with http_client(headers={"accept": "application/json"}) as http:
        status = f"{arm.iri}diagnostics/status"
        eventually(lambda: '{"name":"motor","level":"warning","message":"warm"}' in http.get(status).text, status)


def test_battery_and_diagnostics_are_on_the_page_of_the_robot(arm: Thing) -> None:
    eventually(lambda: {"Charge", "75", "%", "discharging"} <= texts(page(f"{arm.iri}battery")), "the charge")
    eventually(lambda: {"motor", "warning", "warm"} <= texts(page(f"{arm.iri}diagnostics")), "the states")


def page(iri: str) -> str:
    with http_client(headers={"accept": "text/html"}) as http:
        return http.get(iri).text


def texts(html: str) -> set[str]:
    """Return the texts of a page."""
    return {re.sub(r"\s+", " ", each).strip() for each in re.findall(r">([^<]+)<", html)}


def test_joints_move(arm: Thing) -> None:
    assert end_of(begin(arm["pan"].actions["rotate"], value=0.6, unit="rad"))[:2] == ("succeeded", "")
    await_angle(arm, "pan", 0.6, within=0.02)
    assert end_of(begin(arm["ros"].actions["home"]))[:2] == ("succeeded", "")
    await_angle(arm, "pan", 0.0)


def test_a_service_is_an_action_and_a_latched_topic_a_property(arm: Thing) -> None:
    end_of(begin(arm["ros"].actions["set_lamp"], data=False))
    lit = end_of(begin(arm["ros"].actions["set_lamp"], data=True))
    assert lit.said["output"] == {"success": True, "message": "switched"}
    eventually(lambda: arm["ros"].properties["lamp"].reading.values == {"value": True}, "the lamp is on")
    again = end_of(begin(arm["ros"].actions["set_lamp"], data=True))
    assert again[:2] == ("failed", "as it was"), "success is false"


def test_a_service_without_an_answer_fails_and_names_its_time(arm: Thing) -> None:
    assert end_of(begin(arm["ros"].actions["silence"]))[:2] == (
        "failed",
        "it did not end within the 1 s that it may take",
    )


def test_a_goal_has_feedback_and_a_result(arm: Thing) -> None:
    run = begin(arm["ros"].actions["fibonacci"], order=6)
    end = end_of(run)
    assert (end.state, end.said["output"]) == ("succeeded", {"sequence": [0, 1, 1, 2, 3, 5]})
    assert end.said["feedback"] == {"sequence": [0, 1, 1, 2, 3, 5]}
    assert {name: each.number for name, each in run.output.items()} == {
        f"sequence[{at}]": number for at, number in enumerate([0, 1, 1, 2, 3, 5])
    }


def test_a_goal_is_refused(arm: Thing) -> None:
    assert end_of(begin(arm["ros"].actions["fibonacci"], order=-1))[:2] == (
        "failed",
        "/fibonacci does not accept the goal",
    )


def test_a_goal_is_cancelled(arm: Thing) -> None:
    run = begin(arm["ros"].actions["fibonacci"], order=900)
    eventually(lambda: state_of(run).get("feedback"), "a feedback")
    run.cancel()
    assert end_of(run).state == "cancelled"
    # The robot ends it, so that another one begins at once.
    assert end_of(begin(arm["ros"].actions["fibonacci"], order=3)).state == "succeeded"


@pytest.fixture
def full_arm(arm: Thing) -> Thing:
    """Return the robot of hiroz. No wheel has the types of what it has beside that of rclpy."""
    if "navigation" not in arm:
        pytest.skip("rclpy has no wheels of control_msgs and nav2_msgs")
    return arm


def test_a_controller_that_gives_a_trajectory_up_says_why(full_arm: Thing) -> None:
    end = end_of(begin(full_arm["pan"].actions["rotate"], value=1.95, unit="rad"))
    assert end.state == "failed"
    assert end.reason.endswith("the path tolerance is violated (pan: path error 0.2 > 0.1)")


def test_a_grasp_that_meets_something_holds_it(full_arm: Thing) -> None:
    assert end_of(begin(full_arm["gripper"].actions["open"], width=0.08)).state == "succeeded"
    end = end_of(begin(full_arm["gripper"].actions["grasp"], force=20))
    assert (end.state, end.said["output"]["holding"]) == ("succeeded", True)
    assert end.said["output"]["width"] == pytest.approx(0.01)


def test_nav2_drives_to_a_pose_on_the_map(full_arm: Thing) -> None:
    run = begin(full_arm["navigation"].actions["navigateToPose"], x=2.0, y=0.5)
    feedback = eventually(lambda: state_of(run).get("feedback"), "a feedback")
    assert feedback["recoveries"] == 0
    assert end_of(run)[:2] == ("succeeded", "")
    pose = full_arm["navigation"].properties["mapPose"]
    eventually(lambda: {2.0, 0.5} <= {each.number for each in pose.reading.values.values()}, "it is there")


def test_nav2_says_why_it_gives_up(full_arm: Thing, request: pytest.FixtureRequest) -> None:
    """That of Humble has no member for it in its result."""
    why = "" if request.node.callspec.params["robot"] == "humble" else ": error 208 (no valid path found)"
    end = end_of(begin(full_arm["navigation"].actions["navigateToPose"], x=500.0, y=0.5))
    assert end[:2] == ("failed", f"it was given up by the robot{why}")


def test_a_stop_cancels_what_nav2_does(full_arm: Thing) -> None:
    run = begin(full_arm["navigation"].actions["navigateToPose"], x=1.0, y=0.0)
    eventually(lambda: state_of(run).get("feedback"), "a feedback")
    assert end_of(full_arm.actions["stop"]()).state == "succeeded"
    assert end_of(run).state in ("cancelled", "preempted")


def another(session: RosSession, types: MessageTypes) -> ActionClient | None:
    """Return another client of the action that drives, once the action is there."""
    client = ActionClient(session, types, "/navigate_to_pose", "nav2_msgs/action/NavigateToPose")
    return client if client.is_available else None


async def test_a_stop_cancels_the_goal_of_another_client_and_says_so(robot: Peer, full_arm: Thing) -> None:
    types = MessageTypes(preferred="kilted")
    with closing(RosSession(robot.endpoint, 0, "another", type_hash)) as session:
        client = await asyncio.to_thread(eventually, lambda: another(session, types), "the action")
        await client.send(bytes(range(16)), {"pose": {"header": {"frame_id": "map"}, "pose": {"position": {"x": 3.0}}}})
        run = await asyncio.to_thread(full_arm.actions["stop"])
        end = await asyncio.to_thread(end_of, run)
        assert end[:2] == ("succeeded", "a goal of another client of /navigate_to_pose cancelled")
        assert (await client.result(bytes(range(16)))).status == CANCELED
    assert end.reason in await asyncio.to_thread(page, run.iri)
