"""A robot of ROS in a graph in memory, its driver, and an agent, on virtual time."""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec import Raw

from component_agent import Memory
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robots.ros2.address import parse_address
from linked_fleet_agent.robots.ros2.goals import EXECUTING
from linked_fleet_agent.robots.ros2.robot import Ros2Robot
from linked_fleet_agent.robots.ros2.types import MessageTypes
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import DescriptionWithComponents, Operate
from linked_fleet_agent.wire.messages import Command, Move, Progress, Reply, Stop
from memory_ros import MemoryAction, MemoryGraph

URDF = """<robot name="Arm"><link name="base"/><link name="upper"/><link name="tool"/>
  <link name="left"/><link name="right"/>
  <joint name="pan" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1" effort="5"/></joint>
  <joint name="lift" type="revolute"><parent link="upper"/><child link="tool"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="5"/></joint>
  <joint name="finger" type="prismatic"><parent link="tool"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.08" velocity="0.2" effort="40"/></joint>
  <joint name="thumb" type="prismatic"><parent link="tool"/><child link="right"/><axis xyz="0 1 0"/>
    <mimic joint="finger" multiplier="-1" offset="0.01"/>
    <limit lower="-0.08" upper="0.08" velocity="0.2" effort="40"/></joint>
</robot>"""
TRAJECTORY, FOLLOW = "trajectory_msgs/msg/JointTrajectory", "control_msgs/action/FollowJointTrajectory"
ARM, HAND = "/arm_controller", "/gripper_controller"
TICK_S = 0.01


class MemoryArm:
    """The nodes of an arm with a gripper: states, description, controllers and their manager.

    Joints go where the points say at once, and along the trajectories of goals, which then succeed. The test changes
    what it likes in ``positions`` and ``controllers``.
    """

    def __init__(
        self, urdf: str = URDF, actions: bool = True, manager: bool = True, types: MessageTypes | None = None
    ) -> None:
        self.graph = MemoryGraph(types or MessageTypes())
        self.positions = {"pan": 0.0, "lift": 0.0, "finger": 0.04}
        self._taken = 0
        self.stamp_ns: Callable[[], int] = lambda: time.time_ns()
        self.controllers = {"arm_controller": "active", "gripper_controller": "active"}
        self.joints = {"arm_controller": ["pan", "lift"], "gripper_controller": ["finger"]}
        self.graph.publish("/robot_description", "std_msgs/msg/String", {"data": urdf}, latched=True)
        self.graph.offer("subscription", f"{ARM}/joint_trajectory", TRAJECTORY)
        self.arm = MemoryAction(self.graph, f"{ARM}/follow_joint_trajectory", FOLLOW) if actions else None
        self.hand = MemoryAction(self.graph, f"{HAND}/gripper_cmd", "control_msgs/action/GripperCommand")
        if manager:
            listing = "controller_manager_msgs/srv/ListControllers"
            self.graph.serve("/controller_manager/list_controllers", listing, self._list)

    def step(self) -> None:
        """Move, and publish the joint states."""
        if self.arm is not None:
            self._follow(self.arm)
        for topic, outlet in self.graph.outlets.items():
            if topic.type == TRAJECTORY and len(outlet.said) > self._taken:
                self._taken, point = len(outlet.said), outlet.said[-1]
                self.positions |= dict(zip(point["joint_names"], point["points"][-1]["positions"], strict=True))
        sec, nanosec = divmod(self.stamp_ns(), 1_000_000_000)
        header = {"stamp": {"sec": sec, "nanosec": nanosec}}
        said = {"header": header, "name": list(self.positions), "position": list(self.positions.values())}
        self.graph.publish("/joint_states", "sensor_msgs/msg/JointState", said)

    def _follow(self, server: MemoryAction) -> None:
        for goal_id, goal in server.goals.items():
            if goal and server.statuses[goal_id] == EXECUTING:
                elapsed_s = time.monotonic() - server.begun_s[goal_id]
                said = goal["trajectory"]
                times = [_seconds(each["time_from_start"]) for each in said["points"]]
                at = next((index for index, each in enumerate(times) if each >= elapsed_s), len(times) - 1)
                self.positions |= dict(zip(said["joint_names"], said["points"][at]["positions"], strict=True))
                if elapsed_s > times[-1]:
                    server.end(goal_id)

    def sent(self) -> list[dict[str, Any]]:
        """Return the points that the driver has sent to the topic of the arm."""
        return [said for topic, each in self.graph.outlets.items() if topic.name.startswith(ARM) for said in each.said]

    def _list(self, _: Mapping[str, Any]) -> Mapping[str, Any]:
        return {
            "controller": [
                {"name": name, "state": state, "type": "t", "required_command_interfaces": self._interfaces(name)}
                for name, state in self.controllers.items()
            ]
        }

    def _interfaces(self, name: str) -> Sequence[str]:
        return [f"{joint}/position" for joint in self.joints[name]]


def _seconds(said: Mapping[str, int]) -> float:
    return said["sec"] + said["nanosec"] / 1e9


class ArmBench:
    """A memory arm with its driver and agent, which tick while the test waits."""

    def __init__(self, arm: MemoryArm, options: str = "") -> None:
        self.arm, self.link = arm, Memory()
        self._address = parse_address(f"ros2:tcp/127.0.0.1:1{options}")

    async def __aenter__(self) -> "ArmBench":
        self.arm.step()
        self.robot = await Ros2Robot.join("arm", self._address, self.arm.graph)
        self.agent = Agent("arm", self.robot)
        await self.run(0.1)
        return self

    async def __aexit__(self, *_: object) -> None:
        self.robot.close()

    async def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            await asyncio.sleep(TICK_S)
            self.arm.step()
            self.agent.tick(self.link)

    async def leave(self) -> None:
        """End the agent, as a signal does."""
        running = asyncio.ensure_future(self.agent.run(self.link))
        await asyncio.sleep(TICK_S)
        running.cancel()
        await asyncio.wait({running})
        await asyncio.sleep(TICK_S)

    def declared(self, component: str) -> dict[str, Any]:
        """Return the declaration of a component."""
        said = codec.decode(self.agent.description, DescriptionWithComponents)
        found: dict[str, Any] = next(each for each in msgspec.json.decode(said.components) if each["name"] == component)
        return found

    def move(self, id: str, **targets: float) -> Reply:
        asked = Command(
            version=1, id=id, incarnation=self.agent.incarnation, seen_ns=time.monotonic_ns(),
            time_to_live_ns=60_000_000_000, motion=Move(targets),
        )  # fmt: skip
        return codec.decode_reply(self.agent.handle(codec.encode(asked)))

    def operate(self, id: str, component: str, action: str, **given: Any) -> Reply:
        asked = Operate(
            version=2, id=id, incarnation=self.agent.incarnation, seen_ns=time.monotonic_ns(),
            time_to_live_ns=60_000_000_000, component=component, action=action, input=Raw(msgspec.json.encode(given)),
        )  # fmt: skip
        return codec.decode_reply(self.agent.handle_operate(codec.encode(asked)))

    def stop(self, id: str) -> None:
        self.agent.handle_stop(codec.encode(Stop(version=1, id=id)))

    def end(self, id: str) -> Progress:
        return [each for each in self.link.progress if each.id == id][-1]

    def value(self, component: str, name: str) -> Any:
        """Return a value as the agent gives it to gateways; None if it is not known."""
        said = msgspec.json.decode(self.agent.values())
        return said["components"][component]["values"].get(name)
