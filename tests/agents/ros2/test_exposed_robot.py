"""A robot whose configuration makes components of further topics, services and actions, on virtual time."""

from pathlib import Path
from typing import Any

import pytest

from linked_fleet_agent.robots.ros2.address import AddressError
from linked_fleet_agent.robots.ros2.goals import SUCCEEDED
from linked_fleet_agent.robots.ros2.types import MessageTypes
from memory_arm import ArmBench, MemoryArm
from memory_ros import MemoryAction

pytestmark = pytest.mark.virtual
FILE = """
[[property]]
topic = "temperature"
type = "sensor_msgs/msg/Temperature"
field = "temperature"
unit = "DEG_C"

[[action]]
service = "home"
moves = ["pan", "lift"]

[[action]]
action = "count"
"""


class MemoryTool(MemoryArm):
    """An arm with a thermometer, a homing service and a task that moves nothing."""

    def __init__(self, folder: Path) -> None:
        super().__init__(types=MessageTypes([folder]))
        self.homed = 0
        self.graph.serve("/home", "std_srvs/srv/Trigger", self._home)
        self.count = MemoryAction(self.graph, "/count", "test_msgs/action/Fibonacci")

    def _home(self, _: dict[str, Any]) -> dict[str, Any]:
        self.homed += 1
        return {"success": False, "message": "the brake is closed"}


@pytest.fixture
def options(tmp_path: Path) -> str:
    file = tmp_path / "test_msgs" / "action" / "Fibonacci.action"
    file.parent.mkdir(parents=True)
    file.write_text("int32 order\n---\nint32[] sequence\n---\nint32[] sequence")
    (tmp_path / "arm.toml").write_text(FILE)
    return f"?config={tmp_path}/arm.toml&types={tmp_path}"


@pytest.fixture
def arm(options: str, tmp_path: Path) -> MemoryTool:
    return MemoryTool(tmp_path)


async def test_a_topic_of_the_configuration_is_a_property(options: str, arm: MemoryTool) -> None:
    async with ArmBench(arm, options) as bench:
        assert bench.value("ros", "temperature") is None
        arm.graph.publish("/temperature", "sensor_msgs/msg/Temperature", {"temperature": 21.5})
        await bench.run(0.5)
        assert bench.value("ros", "temperature") == 21.5


async def test_a_service_that_moves_joints_is_a_motion_and_fails_with_the_reason(options: str, arm: MemoryTool) -> None:
    async with ArmBench(arm, options) as bench:
        bench.move("m", pan=1.0)
        await bench.run(0.2)
        bench.operate("h", "ros", "home")
        await bench.run(1.0)
        assert (bench.end("m").state, arm.homed) == ("preempted", 1)
        assert (bench.end("h").state, bench.end("h").reason) == ("failed", "the brake is closed")


async def test_a_task_goes_on_when_its_agent_ends_and_the_next_agent_tells_of_it(options: str, arm: MemoryTool) -> None:
    id = "726f58a4-8878-4973-b9c7-05bd9541d91d"
    async with ArmBench(arm, options) as bench:
        bench.operate(id, "ros", "count")
        await bench.run(0.3)
        [goal_id] = arm.count.goals
        await bench.leave()
    async with ArmBench(arm, options) as bench:
        await bench.run(0.5)
        assert bench.end(id).state == "running"
        arm.count.end(goal_id, SUCCEEDED, sequence=[1, 1, 2])
        await bench.run(0.5)
        assert (bench.end(id).state, bytes(bench.end(id).result or b"")) == ("succeeded", b'{"sequence":[1,1,2]}')
    assert not [name for name, _ in arm.graph.calls if name == "/count/_action/cancel_goal"]


async def test_what_is_exposed_by_a_pattern_is_taken_up_when_it_comes(arm: MemoryTool) -> None:
    async with ArmBench(arm, "?expose=/lamp*&expose=/home") as bench:
        assert "home" in bench.declared("ros")["actions"]
        arm.graph.publish("/lamp", "std_msgs/msg/Bool", {"data": True}, latched=True)
        with pytest.raises(Exception, match="more that is exposed has come"):
            await bench.run(45.0)


async def test_a_configuration_that_is_wrong_says_where(arm: MemoryTool, tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text('[[property]]\ntopik = "a"\n')
    with pytest.raises(AddressError, match=r"\[\[property\]\] number 1: .*topik"):
        async with ArmBench(arm, f"?config={tmp_path}/arm.toml"):
            pass
