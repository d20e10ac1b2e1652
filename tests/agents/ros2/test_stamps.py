"""Time stamps that are no times: one sentence, and the time of arrival counts."""

import logging
import time

import pytest

from linked_fleet_agent.robots.ros2.stamps import Stamps
from memory_arm import ArmBench, MemoryArm

WALL_NS = 1_900_000_000_000_000_000


@pytest.mark.parametrize(
    ("stamps_s", "said"),
    [
        ([0.0, 0.01, 0.02, 0.03], ""),
        ([0.0, 0.01, 0.01, 0.02], ""),  # a repeated message
        ([0.0] * 12, "all the same time stamp"),
        ([0.0, 0.01, -0.5], "0.51 s before the one before it"),
        ([0.0, 0.01, 30.0], "30 s apart, but came 0.01 s after each other"),
        ([-3600.0, -3599.99], "of another clock"),
        ([-WALL_NS / 1e9], "no time stamps"),
        ([-WALL_NS / 1e9 + 12.0, -WALL_NS / 1e9 + 12.01], "such as that of a simulation"),
    ],
)
def test_what_is_wrong_with_stamps_is_said(stamps_s: list[float], said: str) -> None:
    stamps = Stamps()
    for count, at_s in enumerate(stamps_s):
        stamps.update(WALL_NS + round(at_s * 1e9), 0.01 * count, WALL_NS + 10_000_000 * count)
    assert said in stamps.finding and bool(said) == bool(stamps.finding)


@pytest.mark.virtual
async def test_a_robot_whose_clock_runs_backwards_is_measured_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    arm = MemoryArm()
    arm.stamp_ns = lambda: 10**18 - time.monotonic_ns()
    with caplog.at_level(logging.WARNING):
        async with ArmBench(arm) as bench:
            await bench.run(2.0)
            assert [each.positions[0] for each in bench.link.states[-20:]] == [0.0] * 20
            times = [each.monotonic_ns for each in bench.link.states]
            assert times == sorted(times)
            [said] = [each for each in bench.value("driver", "missing") if "time stamp" in each]
    assert said.startswith("messages of /joint_states have a time stamp that is 0.0")
    assert said.endswith("s before the one before it; times of arrival count")
    assert sum("time stamp" in record.message for record in caplog.records) == 1


@pytest.mark.virtual
async def test_a_simulated_clock_is_said() -> None:
    arm = MemoryArm()
    arm.graph.publish("/clock", "rosgraph_msgs/msg/Clock", {"clock": {"sec": 12}})
    async with ArmBench(arm) as bench:
        assert bench.value("driver", "timeSource") == "simulated"
