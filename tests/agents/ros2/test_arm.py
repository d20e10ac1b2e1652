"""An arm of ROS with controllers and a gripper, in a graph in memory, on virtual time."""

import math
from typing import Any

import pytest

from linked_fleet_agent.robots.ros2.goals import ABORTED, SUCCEEDED
from linked_fleet_agent.wire.messages import Refused
from memory_arm import TRAJECTORY, URDF, ArmBench, MemoryArm
from memory_ros import MemoryAction

pytestmark = pytest.mark.virtual


async def test_controllers_and_their_joints_are_found_without_configuration() -> None:
    async with ArmBench(MemoryArm()) as bench:
        facts = bench.robot.describe()
        assert facts.coupled == (("pan", "lift"),)
        assert {joint.name: joint.passive for joint in facts.joints} == {
            "pan": False, "lift": False, "finger": True, "thumb": False,
        }  # fmt: skip
        assert bench.robot.read(0.0).positions == pytest.approx((0.0, 0.0, 0.04, -0.03)), "mimic joints are derived"


@pytest.mark.parametrize("others", [0, 1])
async def test_a_controller_whose_joints_nobody_states_has_all_of_them_if_it_is_the_only_one(others: int) -> None:
    """As behind a bridge of DDS, where the services of Fast DDS do not answer."""
    arm = MemoryArm(actions=False, manager=False)
    for each in range(others):
        arm.graph.offer("subscription", f"/other_{each}/joint_trajectory", TRAJECTORY)
    async with ArmBench(arm) as bench:
        assert bench.robot.describe().coupled == (("pan", "lift", "finger"),)
        bench.move("m", pan=0.5)
        await bench.run(2.0)
        assert (bench.end("m").state == "succeeded") == (not others)


async def test_a_motion_is_a_goal_with_result() -> None:
    arm = MemoryArm()
    async with ArmBench(arm) as bench:
        bench.move("m", pan=0.5)
        await bench.run(0.1)
        assert arm.arm is not None
        [(goal_id, goal)] = arm.arm.goals.items()
        points = goal["trajectory"]["points"]
        assert goal["trajectory"]["joint_names"] == ["pan", "lift"]
        assert points[-1]["positions"] == pytest.approx([0.5, 0.0])
        await bench.run(points[-1]["time_from_start"]["sec"] + 1.5)
        assert arm.arm.statuses == {goal_id: SUCCEEDED}
        assert bench.end("m").state == "succeeded", bench.end("m")
        assert arm.sent() == []
        assert goal["goal_tolerance"] == [], "that of the controller"


async def test_the_tolerance_of_the_address_is_that_of_goals() -> None:
    arm = MemoryArm()
    async with ArmBench(arm, "?tolerance=0.01") as bench:
        bench.move("m", pan=0.5)
        await bench.run(0.1)
        assert arm.arm is not None
        [goal] = arm.arm.goals.values()
        said = [(each["name"], each["position"]) for each in goal["goal_tolerance"]]
        assert said == [("pan", 0.01), ("lift", 0.01)]


async def test_a_controller_that_does_not_say_why_has_told_where_the_joints_were() -> None:
    arm = MemoryArm()
    async with ArmBench(arm) as bench:
        bench.move("m", pan=0.5)
        await bench.run(0.1)
        assert arm.arm is not None
        goal_id = next(iter(arm.arm.goals))
        errors = {"positions": [0.02, -0.31, math.inf]}
        arm.arm.tell(goal_id, joint_names=["pan", "lift", "more"], error=errors)
        arm.arm.end(goal_id, ABORTED, error_code=-4)
        await bench.run(0.2)
        said = "the path tolerance is violated (lift was 0.31 off its trajectory)"
        assert bench.end("m").reason == f"{arm.arm.name}: {said}"


@pytest.mark.parametrize(
    ("code", "text", "said"),
    [
        (
            -4,
            "pan 0.3 behind",
            "the path tolerance is violated (pan 0.3 behind)",
        ),
        (-5, "", "the goal tolerance is violated"),
    ],
)
async def test_a_controller_that_gives_up_says_why(code: int, text: str, said: str) -> None:
    arm = MemoryArm()
    async with ArmBench(arm) as bench:
        bench.move("m", pan=0.5)
        await bench.run(0.1)
        assert arm.arm is not None
        arm.arm.end(next(iter(arm.arm.goals)), ABORTED, error_code=code, error_string=text)
        await bench.run(0.2)
        assert (bench.end("m").state, bench.end("m").reason) == ("failed", f"{arm.arm.name}: {said}")


async def test_an_inactive_controller_refuses_at_once_and_works_when_it_is_active() -> None:
    arm = MemoryArm()
    arm.controllers["arm_controller"] = "inactive"
    async with ArmBench(arm) as bench:
        refused = bench.move("m", pan=0.5)
        assert isinstance(refused, Refused)
        assert refused.reason == "pan takes no command now: arm_controller is inactive"
        assert "pan: arm_controller is inactive" in bench.value("driver", "missing")
        arm.controllers["arm_controller"] = "active"
        await bench.run(5.0)
        assert not isinstance(bench.move("n", pan=0.5), Refused)


async def test_a_stop_cancels_all_goals_also_those_of_other_clients_and_says_so() -> None:
    arm = MemoryArm()
    async with ArmBench(arm) as bench:
        assert arm.arm is not None
        bench.move("m", pan=1.5)
        await bench.run(0.3)
        arm.arm.adopt(bytes(range(16)))
        bench.stop("s")
        await bench.run(1.0)
        cancels = [
            asked["goal_info"] for name, asked in arm.graph.calls if name == f"{arm.arm.name}/_action/cancel_goal"
        ]
        assert {"goal_id": {"uuid": bytes(16)}, "stamp": {"sec": 0, "nanosec": 0}} in cancels
        assert bench.end("m").state == "cancelled"
        assert bench.end("s").state == "succeeded"
        assert bench.end("s").reason == "a goal of another client of /arm_controller/follow_joint_trajectory cancelled"
        assert arm.sent(), "and the joints are held by the topic"


async def test_a_server_that_does_not_answer_leaves_the_topic() -> None:
    """Behind a bridge of DDS, actions of FastDDS nodes are offered and never answer."""
    arm = MemoryArm()
    for part in ("send_goal", "cancel_goal", "get_result"):
        kind = {"cancel_goal": "action_msgs/srv/CancelGoal"}.get(part) or (
            "control_msgs/action/FollowJointTrajectory_" + {"send_goal": "SendGoal", "get_result": "GetResult"}[part]
        )
        arm.graph.serve(f"/arm_controller/follow_joint_trajectory/_action/{part}", kind, lambda _: None)
    async with ArmBench(arm) as bench:
        bench.move("m", pan=0.5)
        await bench.run(3.0)
        assert bench.end("m").state == "succeeded"
        assert arm.positions["pan"] == pytest.approx(0.5, abs=1e-3)
        assert any("does not answer" in each for each in bench.value("driver", "missing"))


async def test_a_gripper_grasps_holds_and_loses() -> None:
    arm = MemoryArm()
    async with ArmBench(arm) as bench:
        assert bench.value("gripper", "width") == pytest.approx(0.04)
        bench.operate("g", "gripper", "grasp", force=20)
        await bench.run(0.2)
        [(goal_id, goal)] = arm.hand.goals.items()
        assert goal == {"command": {"position": 0.0, "max_effort": 20.0}}
        arm.positions["finger"] = 0.02
        arm.hand.end(goal_id, ABORTED, position=0.02, effort=20.0, stalled=True)
        await bench.run(0.3)
        assert bench.end("g").state == "succeeded", bench.end("g")
        assert bench.value("gripper", "holding") is True
        arm.positions["finger"] = 0.0
        await bench.run(0.3)
        assert bench.value("gripper", "holding") is False
        assert [(each.component, each.event) for each in bench.link.events] == [("gripper", "lost")]


async def test_a_gripper_is_cancelled_by_a_stop() -> None:
    arm = MemoryArm()
    async with ArmBench(arm) as bench:
        bench.operate("g", "gripper", "open")
        await bench.run(0.2)
        bench.stop("s")
        await bench.run(1.0)
        assert (bench.end("g").state, bench.end("s").state) == ("cancelled", "succeeded")


async def test_a_parallel_gripper_is_commanded_by_its_joint() -> None:
    arm = MemoryArm()
    arm.graph.leave(*arm.hand.names)
    hand = MemoryAction(arm.graph, "/gripper_controller/gripper_cmd", "control_msgs/action/ParallelGripperCommand")
    async with ArmBench(arm) as bench:
        bench.operate("g", "gripper", "grasp", width=0.01, force=15)
        await bench.run(0.2)
        [(goal_id, goal)] = hand.goals.items()
        said = goal["command"]
        assert (said["name"], said["position"], said["effort"]) == (["finger"], [0.01], [15.0])
        arm.positions["finger"] = 0.03
        hand.end(goal_id, SUCCEEDED, stalled=True, state={"position": [0.03], "effort": [14.0]})
        await bench.run(0.3)
        assert bytes(bench.end("g").result or b"") == b'{"width":0.03,"holding":true,"force":14.0}'


async def test_a_gripper_whose_joint_turns_has_no_width() -> None:
    arm = MemoryArm(URDF.replace('name="finger" type="prismatic"', 'name="finger" type="revolute"'))
    async with ArmBench(arm) as bench:
        assert bench.declared("gripper").get("@type") is None
        assert bench.value("gripper", "position") == pytest.approx(0.04)
        bench.operate("g", "gripper", "moveTo", position=0.08)
        await bench.run(0.2)
        [goal] = arm.hand.goals.values()
        assert goal == {"command": {"position": 0.08, "max_effort": 0.0}}


def serve_parameters(arm: MemoryArm, node: str, **values: dict[str, Any]) -> None:
    """Let a node answer as those of rclcpp do: it tells of none if it lacks one."""

    def answer(asked: dict[str, Any]) -> dict[str, Any]:
        known = set(asked["names"]) <= values.keys()
        return {"values": [values[name] for name in asked["names"]] if known else []}

    arm.graph.serve(f"{node}/get_parameters", "rcl_interfaces/srv/GetParameters", answer)


async def test_a_gripper_controller_that_nobody_lists_says_its_joint() -> None:
    arm = MemoryArm(manager=False)
    serve_parameters(arm, "/gripper_controller", joint={"type": 4, "string_value": "finger"})
    async with ArmBench(arm) as bench:
        assert bench.value("gripper", "width") == pytest.approx(0.04)


@pytest.mark.parametrize("action", ["/fr3_gripper/gripper_action", "/gripper_action", "/ns/gripper_action"])
async def test_the_gripper_of_franka_says_its_joints_beside_its_action(action: str) -> None:
    """Older releases have the action below the node, newer ones beside it."""
    arm = MemoryArm()
    arm.graph.leave(*arm.hand.names)
    MemoryAction(arm.graph, action, "control_msgs/action/GripperCommand")
    node = "/ns/franka_gripper" if action.startswith("/ns") else "/fr3_gripper"
    serve_parameters(arm, node, joint_names={"type": 9, "string_array_value": ["finger", "mimic"]})
    serve_parameters(arm, "/robot_state_publisher", joints={"type": 9, "string_array_value": ["lift"]})
    async with ArmBench(arm) as bench:
        assert bench.value("gripper", "width") == pytest.approx(0.04)


async def test_two_nodes_beside_an_action_that_name_different_joints_name_none() -> None:
    arm = MemoryArm()
    arm.graph.leave(*arm.hand.names)
    MemoryAction(arm.graph, "/gripper_action", "control_msgs/action/GripperCommand")
    for side, joint in (("left", "finger"), ("right", "lift")):
        serve_parameters(arm, f"/{side}_gripper", joint_names={"type": 9, "string_array_value": [joint]})
    async with ArmBench(arm) as bench:
        assert any("does not say which joint" in each for each in bench.value("driver", "missing"))


async def test_a_gripper_whose_joint_nobody_states_is_left_out_and_said() -> None:
    arm = MemoryArm(manager=False)
    async with ArmBench(arm) as bench:
        [said] = [each for each in bench.value("driver", "missing") if "gripper_cmd" in each]
        assert "/gripper_controller does not say which joint" in said
