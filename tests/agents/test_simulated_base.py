"""The base of the simulated TIAGo under its agent: how it drives, and what its wheels and its odometry show."""

import math

import numpy as np
import pytest

from linked_fleet_agent.robots.catalogue import MODELS
from linked_fleet_agent.robots.simulated_parts import MANUAL_SCALE
from linked_fleet_agent.wire.messages import Accepted, Refused
from simulated_bench import Simulated

BASE = "mobile_base"
PART = MODELS["tiago"].parts.base
assert PART is not None
LIMITS = PART.limits


class Tiago(Simulated):
    def __init__(self) -> None:
        super().__init__("tiago")
        assert self.mujoco.base is not None
        self.base = self.mujoco.base
        self.names = [joint.name for joint in self.mujoco.describe().joints]

    def drive(self, id: str = "d", **given: float) -> None:
        reply = self.operate(id, "drive", given, component=BASE)
        assert isinstance(reply, Accepted), reply

    def joint(self, name: str) -> float:
        return self.link.states[-1].positions[self.names.index(name)]

    @property
    def speeds(self) -> list[float]:
        return [math.hypot(*each.base.linear_m_s[:2]) for each in self.link.states if each.base is not None]

    async def drive_on(self, seconds: float, **given: float) -> None:
        """Drive by a new request in each half a second, and come to rest."""
        for number in range(round(2 * seconds)):
            self.drive(f"on{number}", **given, duration=0.6)
            await self.tick(0.5)
        await self.tick(2)


async def test_it_drives_straight_within_its_limits_and_comes_to_rest() -> None:
    tiago = Tiago()
    tiago.drive(linear=0.8, duration=1.0)
    await tiago.tick(3)
    assert tiago.states("d") == ["running", "succeeded"]
    assert tiago.base.pose == pytest.approx((0.8, 0.0, 0.0), abs=0.02)
    accelerations = np.abs(np.diff(tiago.speeds)) / 0.01
    assert accelerations.max() <= LIMITS.linear_acceleration * 1.05
    assert tiago.speeds[-1] == pytest.approx(0.0, abs=1e-4)


async def test_it_turns_on_the_spot_and_drives_arcs() -> None:
    tiago = Tiago()
    await tiago.drive_on(2, angular=1.0)
    x, y, heading = tiago.base.pose
    assert (x, y) == pytest.approx((0, 0), abs=2e-3)
    assert heading == pytest.approx(2.0, abs=0.15)
    tiago = Tiago()
    await tiago.drive_on(4, linear=0.5, angular=0.5)  # a circle of a metre around (0, 1)
    assert math.hypot(tiago.base.pose.x, tiago.base.pose.y - 1.0) == pytest.approx(1.0, abs=0.03)


async def test_it_never_moves_sideways() -> None:
    tiago = Tiago()
    assert isinstance(tiago.operate("s", "drive", {"lateral": 0.2}, component=BASE), Refused)
    tiago.drive(linear=0.5, angular=1.0, duration=1.0)
    for _ in range(150):
        await tiago.tick()
        assert tiago.base.velocity.lateral == pytest.approx(0.0, abs=0.01)


async def test_the_wheels_turn_as_far_as_the_base_rolls() -> None:
    tiago = Tiago()
    before = [tiago.joint(wheel) for wheel in PART.wheels]
    await tiago.drive_on(1, linear=0.4, angular=0.6)
    way = [tiago.joint(wheel) - at for wheel, at in zip(PART.wheels, before, strict=True)]
    assert PART.drive is not None
    rolled = PART.drive.body(*way)
    assert rolled.angular == pytest.approx(tiago.base.pose.heading, abs=0.01)
    assert way[1] > way[0] > 0, "a turn to the left"
    refused = tiago.move("w", wheel_left_joint=1.0)
    assert isinstance(refused, Refused)


async def test_the_odometry_is_true_without_drift_and_counts_too_much_with_it() -> None:
    tiago = Tiago()
    await tiago.drive_on(2, linear=0.5, angular=0.3)
    assert tiago.shown(BASE)["pose"] == pytest.approx(tiago.shown("simulation")["truePose"], abs=1e-3)
    tiago = Tiago()
    await tiago.set("simulation", "odometryDrift", 0.1)
    await tiago.drive_on(2, linear=0.5)
    shown, true = tiago.shown(BASE)["pose"], tiago.shown("simulation")["truePose"]
    assert shown["x"] == pytest.approx(1.1 * true["x"], abs=2e-3)
    frame = tiago.link.states[-1].base
    assert frame is not None
    assert frame.position_m[0] == pytest.approx(shown["x"], abs=1e-3), "frames have the odometry"


async def test_the_speed_scale_of_the_mode_reduces_its_speed_on_the_same_arc() -> None:
    tiago = Tiago()
    await tiago.set("mode", "mode", "manual")
    await tiago.drive_on(2, linear=0.8, angular=0.4)
    assert max(tiago.speeds) == pytest.approx(MANUAL_SCALE * 0.8, abs=0.005)
    x, y, _ = tiago.base.pose
    assert math.hypot(x, y - 2.0) == pytest.approx(2.0, abs=0.02), "a circle of two metres around (0, 2)"


@pytest.mark.parametrize("way", ["stop", "protective stop"])
async def test_a_stop_brakes_it_within_its_limits(way: str) -> None:
    tiago = Tiago()
    tiago.drive(linear=1.0, duration=1.0)
    await tiago.tick(0.9)
    if way == "stop":
        tiago.stop("s")
    else:
        await tiago.do("simulation", "stopProtectively", 0.01)
    await tiago.tick(1.2)
    assert tiago.speeds[-1] == pytest.approx(0.0, abs=1e-4)
    assert tiago.states("d")[-1] == ("cancelled" if way == "stop" else "failed")
    at = tiago.base.pose
    await tiago.tick(1)
    assert tiago.base.pose == pytest.approx(at, abs=1e-4)


async def test_a_moving_arm_leaves_the_base_where_it_is() -> None:
    tiago = Tiago()
    assert isinstance(tiago.move("a", arm_1_joint=2.0, arm_2_joint=0.5, torso_lift_joint=0.3), Accepted)
    await tiago.tick(6)
    assert tiago.states("a")[-1] == "succeeded"
    assert tiago.base.pose == pytest.approx((0, 0, 0), abs=1e-3)


async def test_the_arm_moves_while_the_base_drives() -> None:
    tiago = Tiago()
    assert isinstance(tiago.move("a", arm_1_joint=1.0), Accepted)
    await tiago.drive_on(3, linear=0.4)
    assert tiago.states("a")[-1] == "succeeded"
    assert tiago.joint("arm_1_joint") == pytest.approx(1.0, abs=1e-3)
    assert tiago.base.pose == pytest.approx((1.24, 0, 0), abs=0.06)
