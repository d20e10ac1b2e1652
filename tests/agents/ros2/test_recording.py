"""What real programs of ROS 2 said (peers/recording.json) is what the driver reads and writes, byte for byte."""

import json
import re
from typing import Any

import pytest

from linked_fleet_agent.robots.ros2.graph import Interface, Offer
from linked_fleet_agent.robots.ros2.transports import DdsBridge, RmwZenoh, Transport, attachment
from linked_fleet_agent.robots.ros2.types import MessageTypes
from ros_peers import SOURCES
from ros_recording import GID, GOAL, NO_GOAL, OTHER_GOAL, RECORDING
from running import ROOT

SAID = json.loads(RECORDING.read_text(encoding="utf-8"))
TYPES = MessageTypes([SOURCES / "interfaces_of_tests", SOURCES / "interfaces_of_rclpy"], preferred="kilted")
TRANSPORTS: dict[str, Transport] = {"rmw_zenoh": RmwZenoh(0), "humble": RmwZenoh(0), "bridge": DdsBridge()}
DRIVER = ROOT / "agents/linked_fleet_agent/robots/ros2"
_TYPE = re.compile(r'"([a-z][a-z0-9_]*/(?:msg|srv|action)/[A-Za-z0-9]+)"')
WITHOUT_WHEELS = ("control_msgs", "controller_manager_msgs", "nav2_msgs", "tf2_msgs", "ur_dashboard_msgs")
"""Packages of messages that rosbags and hiroz write instead: see test_serialization.py and peers/README.md."""
ZERO_STAMP = {"sec": 0, "nanosec": 0}
FIBONACCI = TYPES.action("test_msgs/action/Fibonacci")
CANCEL = TYPES.service("action_msgs/srv/CancelGoal")
GOAL_PARTS = {
    "send_goal": FIBONACCI.send_goal,
    "get_result": FIBONACCI.get_result,
    "cancel_goal": CANCEL,
}


def uuid(goal: bytes) -> dict[str, Any]:
    return {"uuid": goal}


def info(goal: bytes) -> dict[str, Any]:
    return {"goal_id": uuid(goal), "stamp": ZERO_STAMP}


# Part, request and response of each question, as ros_recording.py asks.
EXCHANGE: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("set_lamp", {"data": True}, {"success": True, "message": "switched"}),
    ("home", {}, {"success": True, "message": "on its way"}),
    ("send_goal", {"goal_id": uuid(NO_GOAL), "goal": {"order": -1}}, {"accepted": False, "stamp": ZERO_STAMP}),
    ("send_goal", {"goal_id": uuid(GOAL), "goal": {"order": 4}}, {"accepted": True, "stamp": ZERO_STAMP}),
    ("get_result", {"goal_id": uuid(GOAL)}, {"status": 4, "result": {"sequence": [0, 1, 1, 2]}}),
    ("get_result", {"goal_id": uuid(GOAL)}, {"status": 4, "result": {"sequence": [0, 1, 1, 2]}}),
    ("send_goal", {"goal_id": uuid(OTHER_GOAL), "goal": {"order": 100}}, {"accepted": True, "stamp": ZERO_STAMP}),
    ("cancel_goal", {"goal_info": info(bytes(16))}, {"return_code": 0, "goals_canceling": [info(OTHER_GOAL)]}),
    ("get_result", {"goal_id": uuid(OTHER_GOAL)}, {"status": 5, "result": {"sequence": [0, 1, 1]}}),
    ("cancel_goal", {"goal_info": info(OTHER_GOAL)}, {"return_code": 3, "goals_canceling": []}),
    ("cancel_goal", {"goal_info": info(NO_GOAL)}, {"return_code": 2, "goals_canceling": []}),
]


@pytest.mark.parametrize("name", SAID["messages"])
def test_a_message_of_rclpy_is_read_and_written_byte_for_byte(name: str) -> None:
    said = SAID["messages"][name]
    cdr, type_ = bytes.fromhex(said["cdr"]), TYPES.message(name)
    assert _with_lists(type_.read(cdr)) == said["value"]
    written = type_.write(said["value"])
    padding = len(cdr) - len(written)
    assert written + bytes(padding) == cdr and padding < 4


def test_every_message_that_the_driver_names_is_one_of_these_if_a_wheel_has_it() -> None:
    named = {name for path in DRIVER.glob("*.py") for name in _TYPE.findall(path.read_text(encoding="utf-8"))}
    parts = [f"{name}{part}" for name in named for part in (("_Request", "_Response") if "/srv/" in name else ("",))]
    assert sorted(each for each in parts if each.split("/")[0] not in WITHOUT_WHEELS) == sorted(
        each for each in parts if each in SAID["messages"]
    )


@pytest.mark.parametrize("name", [name for name, said in SAID["messages"].items() if said["hash"]])
def test_a_type_has_the_hash_that_rclpy_states(name: str) -> None:
    assert TYPES.message(name, SAID["messages"][name]["hash"]).hash == SAID["messages"][name]["hash"]


@pytest.mark.parametrize("side", TRANSPORTS)
def test_all_tokens_but_those_of_nodes_and_of_the_bridge_are_offers(side: str) -> None:
    strange = [token for token in SAID[side]["tokens"] if not TRANSPORTS[side].offers_of(token)]
    node = "@ros2_lv/0/ID/0/NUMBER/NN/%/%/hiroz_robot"
    own = {
        "rmw_zenoh": [node],
        "humble": [node],
        # A client of an action offers nothing.
        "bridge": ["@/ID/@ros2_lv", "@/ID/@ros2_lv/AC/fastdds§fibonacci/test_msgs§action§Fibonacci"],
    }
    assert strange == own[side]


@pytest.mark.parametrize("side", TRANSPORTS)
def test_tokens_name_roles_types_hashes_and_what_is_latched(side: str) -> None:
    hashed = {
        name: "" if side == "humble" else SAID["messages"][name]["hash"]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/String", "trajectory_msgs/msg/JointTrajectory")
    }
    state, text, trajectory = hashed
    commands = "/joint_trajectory_controller/joint_trajectory"
    said = [each._replace(key_hash="") for each in offers(side)]
    assert Offer("publisher", Interface("/joint_states", state), hashed[state]) in said
    assert Offer("publisher", Interface("/robot_description", text), hashed[text], latched=True) in said
    assert Offer("subscription", Interface(commands, trajectory), hashed[trajectory]) in said
    parts = {offer.interface: offer.latched for offer in said if offer.interface.name.startswith("/fibonacci/")}
    assert parts == {
        Interface("/fibonacci/_action/send_goal", "test_msgs/action/Fibonacci_SendGoal"): False,
        Interface("/fibonacci/_action/get_result", "test_msgs/action/Fibonacci_GetResult"): False,
        Interface("/fibonacci/_action/cancel_goal", "action_msgs/srv/CancelGoal"): False,
        Interface("/fibonacci/_action/feedback", "test_msgs/action/Fibonacci_FeedbackMessage"): False,
        Interface("/fibonacci/_action/status", "action_msgs/msg/GoalStatusArray"): True,
    }


def test_nodes_of_humble_state_no_hash_and_have_a_word_in_its_place_in_keys() -> None:
    assert {(each.type_hash, each.key_hash) for each in offers("humble")} == {("", "TypeHashNotSupported")}


def test_types_of_services_and_actions_have_the_hashes_that_hiroz_states() -> None:
    stated = {offer.interface.type: offer.type_hash for offer in offers("rmw_zenoh")}
    assert {"nav2_msgs/action/NavigateToPose_SendGoal", "controller_manager_msgs/srv/ListControllers"} <= stated.keys()
    # hiroz computes another one than ROS states (type_hashes.json); the driver takes what a node states.
    assert stated.pop("action_msgs/srv/CancelGoal") != TYPES.message("action_msgs/srv/CancelGoal").hash
    assert {name: TYPES.message(name).hash for name in stated} == stated


@pytest.mark.parametrize("side", TRANSPORTS)
def test_requests_are_sent_and_responses_read_as_they_were(side: str) -> None:
    hashes = {offer.interface.name: offer for offer in offers(side)}
    for (part, request, response), said in zip(EXCHANGE, SAID[side]["exchange"], strict=True):
        name = f"/fibonacci/_action/{part}" if part in GOAL_PARTS else f"/{part}"
        offer = hashes[name]
        type_ = GOAL_PARTS.get(part) or TYPES.service(offer.interface.type)
        assert TRANSPORTS[side].key(offer.interface, offer.key_hash) == said["key"]
        assert type_.request.write(request).hex() == said["request"]
        assert type_.response.read(bytes.fromhex(said["reply"])) == response
        assert said.get("attachment") == (attachment(7, 0, GID).hex() if TRANSPORTS[side].attaches else None)


@pytest.mark.parametrize("side", TRANSPORTS)
def test_feedback_and_states_of_goals_are_read(side: str) -> None:
    feedback = [FIBONACCI.feedback_message.read(bytes.fromhex(each)) for each in SAID[side]["feedback"]["messages"]]
    assert feedback[1] == {"goal_id": uuid(GOAL), "feedback": {"sequence": [0, 1, 1, 2]}}
    array = TYPES.message("action_msgs/msg/GoalStatusArray")
    states = [array.read(bytes.fromhex(each))["status_list"] for each in SAID[side]["status"]["messages"]]
    assert [states[n][0]["status"] for n in range(3)] == [1, 2, 4]
    assert states[-1] == [
        {"goal_info": info(GOAL), "status": 4},
        {"goal_info": info(OTHER_GOAL), "status": 5},
    ]


def offers(side: str) -> list[Offer]:
    return [offer for token in SAID[side]["tokens"] for offer in TRANSPORTS[side].offers_of(token)]


def _with_lists(value: Any) -> Any:
    """Return the value as JSON has it: bytes as numbers."""
    if isinstance(value, dict):
        return {name: _with_lists(each) for name, each in value.items()}
    if isinstance(value, list | bytes):
        return [_with_lists(each) for each in value]
    return value
