"""A robot as a ROS 2 node of rclpy: two joints, a battery, diagnostics, a lamp, services and an action.

Arguments: the seconds between two numbers of the action, and a file with the URDF. With MORE_JOINTS in its environment
it has so many joints more, j0 and so on, which swing to and fro. It runs in an environment of its own
(``make ros-peers``).
"""

import contextlib
import json
import math
import os
import sys
from pathlib import Path
from typing import Any

import rclpy
from cyclone_services import Relay
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import BatteryState, JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger
from test_msgs.action import Fibonacci
from trajectory_msgs.msg import JointTrajectory

PERIOD_S, STEP = 0.01, 0.01
MOST_NUMBERS = 1000
INNER = "fastdds"
"""The namespace of the services and the action on Fast DDS, which the bridge does not reach."""


class Robot(Node):
    """A robot that moves its joints by ``STEP`` rad each ``PERIOD_S`` to the last point of the last trajectory."""

    def __init__(self, pause_s: float, urdf: str, more: int) -> None:
        super().__init__("rclpy_robot")
        self.pause_s, self.urdf, self.more = pause_s, urdf, more
        self.positions, self.goals = {"pan": 0.25, "lift": 0.0, "finger": 0.08}, {}
        self.lamp = False
        self._publish()
        self._serve()

    def _publish(self) -> None:
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.description = self.create_publisher(String, "robot_description", latched)
        self.description.publish(String(data=self.urdf))
        self.lamp_state = self.create_publisher(Bool, "lamp", latched)
        self.lamp_state.publish(Bool(data=self.lamp))
        self.states = self.create_publisher(JointState, "joint_states", 10)
        self.battery = self.create_publisher(BatteryState, "battery_state", 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self.create_timer(PERIOD_S, self.step)
        self.create_timer(0.5, self.report)

    def _serve(self) -> None:
        topic = "joint_trajectory_controller/joint_trajectory"
        self.create_subscription(JointTrajectory, topic, self.follow, 10)
        self.create_service(SetBool, f"{INNER}/set_lamp", self.set_lamp)
        self.create_service(Trigger, f"{INNER}/home", self.home)
        self.create_service(Trigger, f"{INNER}/silence", self.stay_silent, callback_group=ReentrantCallbackGroup())
        self.action = ActionServer(
            self,
            Fibonacci,
            f"{INNER}/fibonacci",
            self.count,
            goal_callback=lambda goal: GoalResponse.ACCEPT if 0 <= goal.order <= MOST_NUMBERS else GoalResponse.REJECT,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
            result_timeout=900,
        )

    def step(self) -> None:
        for name, goal in self.goals.items():
            self.positions[name] += max(-STEP, min(STEP, goal - self.positions[name]))
        now = self.get_clock().now()
        swinging = {f"j{number}": 0.3 * math.sin(now.nanoseconds / 1e9 + number) for number in range(self.more)}
        at = self.positions | swinging
        row = [0.0] * len(at) if swinging else []
        said = JointState(name=list(at), position=list(at.values()), velocity=row, effort=row)
        said.header.stamp = now.to_msg()
        self.states.publish(said)

    def report(self) -> None:
        stamp = self.get_clock().now().to_msg()
        battery = BatteryState(voltage=24.5, percentage=0.75, present=True)
        battery.header.stamp = stamp
        battery.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
        self.battery.publish(battery)
        values = [KeyValue(key="temperature", value="41")]
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN, name="motor", message="warm", hardware_id="m1", values=values
        )
        diagnostics = DiagnosticArray(status=[status])
        diagnostics.header.stamp = stamp
        self.diagnostics.publish(diagnostics)

    def follow(self, trajectory: JointTrajectory) -> None:
        if trajectory.points:
            self.goals = dict(zip(trajectory.joint_names, trajectory.points[-1].positions, strict=True))

    def set_lamp(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = request.data != self.lamp
        response.message = "switched" if response.success else "as it was"
        self.lamp = request.data
        self.lamp_state.publish(Bool(data=self.lamp))
        return response

    def home(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.goals = {"pan": 0.0, "lift": 0.0}
        response.success, response.message = True, "on its way"
        return response

    async def stay_silent(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        await Future()
        return response

    async def count(self, handle: Any) -> Fibonacci.Result:
        """Return as many numbers as the goal says, each of which is a feedback first."""
        numbers = [0, 1]
        while len(numbers) < handle.request.order and not handle.is_cancel_requested:
            await self.pause()
            numbers.append((numbers[-1] + numbers[-2]) % 2**31)
            handle.publish_feedback(Fibonacci.Feedback(sequence=numbers))
        handle.canceled() if handle.is_cancel_requested else handle.succeed()
        return Fibonacci.Result(sequence=numbers)

    async def pause(self) -> None:
        over = Future()
        timer = self.create_timer(self.pause_s, lambda: over.set_result(None))
        await over
        self.destroy_timer(timer)


def main(pause_s: float, urdf: str) -> None:
    rclpy.init()
    robot = Robot(pause_s, urdf, int(os.environ.get("MORE_JOINTS", "0")))
    executor = MultiThreadedExecutor(2)
    executor.add_node(robot)
    relay = Relay(robot, int(os.environ["ROS_DOMAIN_ID"]), INNER)
    print(json.dumps({"ready": robot.get_name(), "relayed": len(relay.readers)}), flush=True)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main(float(sys.argv[1]), Path(sys.argv[2]).read_text())
