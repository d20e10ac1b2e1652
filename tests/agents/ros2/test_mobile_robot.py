"""A mobile robot of ROS in a graph in memory, on virtual time: base, map, Nav2, battery, diagnostics, modes."""

import math
from typing import Any

import pytest

from linked_fleet_agent.robots.ros2 import base
from linked_fleet_agent.robots.ros2.goals import ABORTED, SUCCEEDED
from linked_fleet_agent.wire.messages import Refused
from memory_arm import ArmBench, MemoryArm
from memory_ros import MemoryAction

pytestmark = pytest.mark.virtual
TWIST, ODOMETRY, FRAMES = "geometry_msgs/msg/TwistStamped", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
PARAMETERS = {
    "max_velocity": {"type": 8, "double_array_value": [0.5, 0.0, 1.0]},
    "max_accel": {"type": 8, "double_array_value": [1.0, 0.0, 2.0]},
    "footprint": {"type": 4, "string_value": "[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]"},
    "robot_radius": {"type": 3, "double_value": 0.22},
}


def frame(child: str, parent: str, x: float = 0.0, y: float = 0.0, heading: float = 0.0) -> dict[str, Any]:
    turned = {"x": 0.0, "y": 0.0, "z": math.sin(heading / 2), "w": math.cos(heading / 2)}
    said = {"translation": {"x": x, "y": y, "z": 0.0}, "rotation": turned}
    return {"header": {"frame_id": parent}, "child_frame_id": child, "transform": said}


class MemoryCart(MemoryArm):
    """An arm on a base that Nav2 drives."""

    def __init__(self, prefix: str = "") -> None:
        super().__init__()
        self.prefix, self.at, self.on_map = prefix, (1.0, 2.0, math.pi / 2), (3.0, 0.0, 0.0)
        graph = self.graph
        self.velocity = graph.offer("subscription", "/cmd_vel", TWIST)
        for node in ("/velocity_smoother", "/local_costmap/local_costmap"):
            graph.serve(f"{node}/get_parameters", "rcl_interfaces/srv/GetParameters", self._parameters)
        self.navigate = MemoryAction(graph, "/navigate_to_pose", "nav2_msgs/action/NavigateToPose")
        graph.publish("/battery_state", "sensor_msgs/msg/BatteryState", {"percentage": 0.5, "power_supply_status": 2})
        graph.offer("publisher", "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")

    def step(self) -> None:
        super().step()
        said = [frame(f"{self.prefix}base", f"{self.prefix}odom", *self.at)]
        self.graph.publish("/tf", FRAMES, {"transforms": [*said, frame(f"{self.prefix}odom", "map", *self.on_map)]})
        moving = {"twist": {"twist": {"linear": {"x": 0.2}}}}
        self.graph.publish("/odom", ODOMETRY, {"child_frame_id": f"{self.prefix}base", **moving})

    def said_velocities(self) -> list[tuple[float, float]]:
        said = self.graph.outlets[self.velocity].said
        return [(each["twist"]["linear"]["x"], each["twist"]["angular"]["z"]) for each in said]

    def _parameters(self, asked: dict[str, Any]) -> dict[str, Any]:
        return {"values": [PARAMETERS.get(name, {"type": 0}) for name in asked["names"]]}


@pytest.mark.parametrize("prefix", ["", "cart1/"])
async def test_the_base_is_where_frames_say(prefix: str) -> None:
    async with ArmBench(MemoryCart(prefix)) as bench:
        said = bench.link.states[-1].base
        assert said is not None
        assert said.position_m == pytest.approx((1.0, 2.0, 0.0))
        assert said.linear_m_s == pytest.approx((0.0, 0.2, 0.0), abs=1e-9), "in the frame of the odometry"
        assert bench.value("mobile_base", "pose") == {"x": 1.0, "y": 2.0, "heading": 1.5708}
        assert bench.value("mobile_base", "twist")["linear"] == 0.2
        assert bench.value("navigation", "mapPose") == {"x": 4.0, "y": 2.0, "heading": 1.5708}


async def test_the_base_is_where_the_newest_frames_say_and_nowhere_without_them() -> None:
    cart = MemoryCart()
    async with ArmBench(cart) as bench:
        cart.at = (5.0, 2.0, 0.0)
        await bench.run(0.1)
        said = bench.link.states[-1].base
        assert said is not None and said.position_m[0] == pytest.approx(5.0)
        cart.graph.cut = True
        await bench.run(0.6)
        said = bench.link.states[-1].base
        assert said is not None and math.isnan(said.position_m[0])


async def test_limits_and_outline_are_those_of_nav2() -> None:
    async with ArmBench(MemoryCart()) as bench:
        limits = bench.value("mobile_base", "driveLimits")
        assert (limits["linear"], limits["angular"], limits["linearAcceleration"]) == (0.5, 1.0, 1.0)
        assert bench.value("mobile_base", "footprint")[0] == {"x": 0.3, "y": 0.2}
        assert bench.value("driver", "missing") == []


async def test_a_drive_sends_velocities_brakes_and_then_leaves_the_base_to_others() -> None:
    cart = MemoryCart()
    async with ArmBench(cart) as bench:
        assert cart.said_velocities() == []
        bench.operate("d", "mobile_base", "drive", linear=0.4, duration=0.5)
        await bench.run(0.5)
        assert max(cart.said_velocities()) == pytest.approx((0.4, 0.0))
        await bench.run(1.5)
        assert bench.end("d").state == "succeeded"
        assert cart.said_velocities()[-1] == (0.0, 0.0)
        count = len(cart.said_velocities())
        await bench.run(1.0)
        assert len(cart.said_velocities()) == count


async def test_a_drive_to_a_pose_has_feedback_and_ends_with_nav2() -> None:
    cart = MemoryCart()
    async with ArmBench(cart) as bench:
        bench.operate("n", "navigation", "navigateToPose", x=2.0, y=-1.0, heading=math.pi)
        await bench.run(0.2)
        [(goal_id, goal)] = cart.navigate.goals.items()
        assert goal["pose"]["header"]["frame_id"] == "map"
        assert goal["pose"]["pose"]["position"] == {"x": 2.0, "y": -1.0, "z": 0.0}
        cart.navigate.tell(goal_id, distance_remaining=1.5, number_of_recoveries=1)
        await bench.run(0.3)
        assert bytes(bench.end("n").feedback or b"") == (
            b'{"distanceRemaining":1.5,"navigationTime":0.0,"timeRemaining":0.0,"recoveries":1}'
        )
        cart.navigate.end(goal_id, SUCCEEDED)
        await bench.run(0.3)
        assert bench.end("n").state == "succeeded"


async def test_nav2_says_why_it_has_given_up_and_a_stop_cancels_it() -> None:
    cart = MemoryCart()
    async with ArmBench(cart) as bench:
        bench.operate("n", "navigation", "navigateToPose", x=2.0, y=-1.0)
        await bench.run(0.2)
        cart.navigate.end(next(iter(cart.navigate.goals)), ABORTED, error_code=208, error_msg="no path")
        await bench.run(0.3)
        assert bench.end("n").reason.endswith("it was given up by the robot: error 208 (no path)")
        bench.operate("o", "navigation", "navigateToPose", x=2.0, y=-1.0)
        await bench.run(0.2)
        bench.stop("s")
        await bench.run(1.0)
        assert (bench.end("o").state, bench.end("s").state) == ("cancelled", "succeeded")
        assert (0.0, 0.0) in cart.said_velocities(), "the base is told to stand, whoever drives it"


async def test_a_goal_survives_that_its_server_is_away_for_a_moment() -> None:
    """As when a router or a bridge restarts."""
    cart = MemoryCart()
    async with ArmBench(cart) as bench:
        bench.operate("n", "navigation", "navigateToPose", x=2.0, y=-1.0)
        await bench.run(0.2)
        [goal_id] = cart.navigate.goals
        offers = dict(cart.graph._offers)
        cart.graph.leave(*cart.navigate.names)
        await bench.run(40.0)  # longer than a result is waited for at once
        cart.graph._offers = offers
        cart.navigate.end(goal_id, SUCCEEDED)
        await bench.run(1.0)
        assert bench.end("n").state == "succeeded"


async def test_a_goal_of_a_server_that_has_restarted_is_unknown() -> None:
    cart = MemoryCart()
    async with ArmBench(cart) as bench:
        bench.operate("n", "navigation", "navigateToPose", x=2.0, y=-1.0)
        await bench.run(0.2)
        cart.navigate.forget()
        await bench.run(45.0)
        assert bench.end("n").state == "failed"
        assert (
            "what became of the goal is not known: /navigate_to_pose does not know the goal any more"
            in bench.end("n").reason
        )


async def test_battery_and_diagnostics_are_components() -> None:
    cart = MemoryCart()
    async with ArmBench(cart) as bench:
        assert bench.value("battery", "charge") is None, "nothing was heard since the driver came"
        said = {"percentage": 0.42, "power_supply_status": 1, "voltage": 24.5, "current": math.nan}
        cart.graph.publish("/battery_state", "sensor_msgs/msg/BatteryState", said)
        status = [{"name": "motor", "level": 1, "message": "warm"}, {"name": "fan", "level": 0}]
        cart.graph.publish("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", {"status": status})
        await bench.run(1.5)
        assert bench.value("battery", "charge") == pytest.approx(42.0)
        assert bench.value("battery", "powerSupplyState") == "charging"
        assert bench.value("battery", "current") is None
        assert [(each["name"], each["level"]) for each in bench.value("diagnostics", "status")] == [
            ("motor", "warning"),
            ("fan", "ok"),
        ]


async def test_a_safety_stop_of_the_controller_prevents_motion_with_its_reason() -> None:
    arm = MemoryArm()
    arm.graph.publish("/io/safety_mode", "ur_dashboard_msgs/msg/SafetyMode", {"mode": 1}, latched=True)
    arm.graph.offer("publisher", "/speed_scaling_state_broadcaster/speed_scaling", "std_msgs/msg/Float64")
    async with ArmBench(arm) as bench:
        bench.move("m", pan=1.0)
        await bench.run(0.3)
        arm.graph.publish("/io/safety_mode", "ur_dashboard_msgs/msg/SafetyMode", {"mode": 3}, latched=True)
        scaling = "/speed_scaling_state_broadcaster/speed_scaling"
        arm.graph.publish(scaling, "std_msgs/msg/Float64", {"data": 40.0})
        await bench.run(0.3)
        assert (bench.end("m").state, bench.end("m").reason) == ("failed", "mode: a protective stop is active")
        refused = bench.move("n", pan=0.5)
        assert isinstance(refused, Refused) and "a protective stop is active" in refused.reason
        assert bench.value("mode", "protectiveStop") is True
        assert bench.value("mode", "speedScale") == 0.4


@pytest.mark.parametrize(
    ("footprint", "radius", "count"),
    [
        ("[[1, 0], [0, 1], [-1, 0]]", None, 3),
        ("[[-1, 0], [0, 1], [1, 0]]", None, 3),
        ("[]", 0.3, 8),
        ("nonsense", 0.3, 8),
        ("[[1, 0], [2, 0], [3, 0]]", None, 0),
        ("[[1e9, 0], [0, 1], [-1, 0]]", None, 0),
        (None, math.inf, 0),
        (None, None, 0),
    ],
)
def test_an_outline_is_counterclockwise_or_none(footprint: object, radius: object, count: int) -> None:
    corners = base.corners_of(footprint, radius)
    assert len(corners) == count
    pairs = zip(corners, [*corners[1:], *corners[:1]], strict=True)
    assert not corners or sum(a[0] * b[1] - b[0] * a[1] for a, b in pairs) > 0


async def test_a_robot_is_docked_by_the_server_of_nav2() -> None:
    cart = MemoryCart()
    dock = MemoryAction(cart.graph, "/dock_robot", "nav2_msgs/action/DockRobot")
    MemoryAction(cart.graph, "/undock_robot", "nav2_msgs/action/UndockRobot")
    async with ArmBench(cart) as bench:
        bench.operate("d", "navigation", "dockRobot", dock="home")
        await bench.run(0.2)
        [(goal_id, goal)] = dock.goals.items()
        assert (goal["use_dock_id"], goal["dock_id"]) == (True, "home")
        dock.tell(goal_id, state=2)
        await bench.run(0.3)
        assert bytes(bench.end("d").feedback or b"") == b"2"
        dock.end(goal_id, ABORTED, error_code=901)
        await bench.run(0.3)
        assert bench.end("d").reason.endswith("it was given up by the robot: error 901, DOCK_NOT_IN_DB")
