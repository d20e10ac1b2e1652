"""Charging stations of simulated bases: they dock from many places, and the battery charges while they are docked."""

import asyncio
import math
import random
from itertools import pairwise

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from linked_fleet_agent.planar import Pose
from linked_fleet_agent.robots.catalogue import MODELS
from linked_fleet_agent.robots.simulated_base import RollingBase
from linked_fleet_agent.wire.messages import Accepted
from properties import examples
from simulated_bench import Simulated

BASE = "mobile_base"
PLACE_M, LEVEL_RAD = 0.01, math.radians(1.0)


class Rolling(Simulated):
    """A robot that charges at its station."""

    def __init__(self, source: str = "pmb2") -> None:
        super().__init__(source)
        assert isinstance(self.mujoco.base, RollingBase)
        self.base = self.mujoco.base
        part = MODELS[source].parts
        assert part.base is not None
        assert part.battery is not None
        (station,) = part.base.stations
        self.battery, self.station = part.battery, Pose(station.x, station.y, station.heading)

    async def run(self, action: str, seconds: float = 0.0, /, **given: object) -> str:
        """Carry out an action of the base, for as long as its rehearsal says, and a little longer."""
        await self.tick()
        rehearsed = self.operate(f"r{self.now_ns}", action, given or None, component=BASE, rehearsal=True)
        assert isinstance(rehearsed, Accepted), rehearsed
        return await self.do(BASE, action, seconds or 1.5 * rehearsed.duration_s + 3.0, **given)

    async def go_to(self, pose: Pose) -> None:
        assert await self.run("followPath", path=[pose._asdict()]) == "succeeded"

    async def dock(self) -> None:
        assert await self.run("dock") == "succeeded"
        assert self.shown(BASE)["dockedAt"] == "charger"
        self.check_place()

    def check_place(self) -> None:
        distance_m, turn_rad = self.station.error_of(self.base.pose)
        assert distance_m <= PLACE_M
        assert turn_rad <= LEVEL_RAD

    def drain(self, charge: float) -> None:
        (battery,) = (each for each in self.mujoco.components() if each.name == "battery")
        battery.energy_j = charge * self.battery.capacity_wh * 36.0  # type: ignore[attr-defined]

    @property
    def charge(self) -> float:
        (battery,) = (each for each in self.mujoco.components() if each.name == "battery")
        return battery.energy_j / 3600.0  # type: ignore[attr-defined, no-any-return]


@pytest.mark.parametrize("source", ["tiago", "pmb2"])
async def test_it_docks_from_where_it_begins_and_charges(source: str) -> None:
    robot = Rolling(source)
    robot.drain(50.0)
    assert robot.shown("battery")["powerSupplyState"] == "discharging"
    await robot.dock()
    assert robot.shown("battery")["powerSupplyState"] == "charging"
    before_wh = robot.charge
    await robot.tick(36)
    gained_w = (robot.charge - before_wh) * 100.0
    assert gained_w == pytest.approx(robot.battery.charger_w - robot.battery.idle_w, rel=0.01)
    robot.drain(99.99)
    await robot.tick(2)
    assert robot.shown("battery") == {"charge": 100.0, "powerSupplyState": "full"}
    assert await robot.run("undock") == "succeeded"
    assert robot.station.ahead_m(robot.base.pose) == pytest.approx(-0.4, abs=0.01)
    assert robot.shown("battery")["powerSupplyState"] == "discharging"


def in_front(robot: Rolling, draw: random.Random) -> Pose:
    """Return a random pose in front of the station, up to 1.9 m away, that looks anywhere."""
    turn, far_m = draw.uniform(-1.4, 1.4), draw.uniform(0.1, 1.9)
    x, y, heading = robot.station
    direction = heading + math.pi + turn
    return Pose(x + far_m * math.cos(direction), y + far_m * math.sin(direction), draw.uniform(-3, 3))


@given(seed=st.integers(0, 10_000))
@settings(max_examples=examples(20))
def test_it_docks_from_anywhere_in_front(seed: int) -> None:
    async def dock() -> None:
        robot = Rolling()
        await robot.go_to(in_front(robot, random.Random(seed)))
        await robot.dock()

    asyncio.run(dock())


async def test_it_drives_straight_into_the_station() -> None:
    robot = Rolling()
    await robot.go_to(Pose(0.4, 0.8, 2.0))
    reply = robot.operate("d", "dock", {}, component=BASE)
    assert isinstance(reply, Accepted)
    poses = []
    while robot.states("d")[-1:] != ["succeeded"]:
        await robot.tick(0.02)
        poses.append(robot.base.pose)
    last = [pose for pose in poses if robot.station.ahead_m(pose) > -0.39]
    assert len(last) > 100, "slowly"
    assert max(abs(pose.y) for pose in last) <= 0.015
    assert all(after.x >= before.x - 1e-3 for before, after in pairwise(last))


async def test_drifting_odometry_sees_the_station_where_it_is() -> None:
    robot = Rolling()
    await robot.set("simulation", "odometryDrift", 0.02)
    await robot.go_to(Pose(0.5, 1.2, -2.0))
    await robot.go_to(Pose(-0.3, -0.5, 1.0))
    await robot.dock()
    assert robot.shown(BASE)["stations"][0]["x"] > 1.205


async def test_any_motion_away_ends_the_charging() -> None:
    robot = Rolling()
    await robot.dock()
    assert await robot.do(BASE, "drive", 1.5, linear=-0.2, duration=0.3) == "succeeded"
    assert robot.shown("battery")["powerSupplyState"] == "discharging"
    assert robot.shown(BASE)["dockedAt"] == ""


async def test_a_stop_on_the_last_piece_does_not_charge_and_it_docks_again() -> None:
    robot = Rolling()
    robot.operate("d", "dock", {}, component=BASE)
    while not (robot.link.progress and robot.link.progress[-1].reason == "into charger"):
        await robot.tick(0.1)
    await robot.tick(1)
    assert isinstance(robot.stop("s"), Accepted)
    await robot.tick(2)
    assert robot.states("d")[-1] == "cancelled"
    assert robot.shown("battery")["powerSupplyState"] == "discharging"
    await robot.dock()


async def test_driving_drains_the_battery_more_than_standing() -> None:
    robot = Rolling()
    before_wh = robot.charge
    await robot.tick(10)
    stood_wh, before_wh = before_wh - robot.charge, robot.charge
    robot.operate("f", "followPath", {"path": [{"x": 9, "y": 0}]}, component=BASE)
    await robot.tick(10)
    drove_wh = before_wh - robot.charge
    assert stood_wh == pytest.approx(robot.battery.idle_w * 10 / 3600, rel=0.01)
    assert drove_wh - stood_wh == pytest.approx(2.0 * 30.0 * robot.base.pose.x / 3600, rel=0.5)


async def test_the_result_says_how_it_stands() -> None:
    robot = Rolling()
    await robot.dock()
    result = msgspec.json.decode(robot.link.progress[-1].result)
    assert result["station"] == "charger"
    assert result["error"] == pytest.approx(robot.station.error_of(robot.base.pose)[0], abs=2e-3)
