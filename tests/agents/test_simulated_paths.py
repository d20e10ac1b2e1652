"""Paths that the simulated TIAGo follows under its agent: within the tolerance, to the last pose."""

import asyncio
import random

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from linked_fleet_agent.planar import Pose
from linked_fleet_agent.smooth_path import TOLERANCE_M
from linked_fleet_agent.wire.messages import Accepted
from paths import LEVEL_RAD, PLACE_M, cut_m, off_m
from properties import examples
from simulated_bench import Simulated


class Tiago(Simulated):
    """The robot, of which every pose is kept."""

    def __init__(self) -> None:
        super().__init__("tiago")
        assert self.mujoco.base is not None
        self.base = self.mujoco.base
        self.poses = [self.base.pose]

    async def follow(self, path: list[Pose], **given: object) -> None:
        request = {"path": [each._asdict() for each in path], **given}
        rehearsed = self.operate("r", "followPath", request, component="mobile_base", rehearsal=True)
        assert isinstance(rehearsed, Accepted)
        assert isinstance(self.operate("f", "followPath", request, component="mobile_base"), Accepted)
        for _ in range(round(150 * rehearsed.duration_s + 300)):
            await self.tick()
            self.poses.append(self.base.pose)

    def check(self, path: list[Pose]) -> None:
        assert self.states("f") == ["running", "succeeded"], self.end("f").reason
        assert off_m(self.poses, [Pose(), *path]) <= TOLERANCE_M
        assert cut_m(self.poses, [Pose(), *path]) <= TOLERANCE_M
        distance_m, turn_rad = path[-1].error_of(self.base.pose)
        assert distance_m <= PLACE_M
        assert turn_rad <= LEVEL_RAD
        result = msgspec.json.decode(self.end("f").result)
        assert (result["error"], result["headingError"]) == pytest.approx((distance_m, turn_rad), abs=0.002)


@pytest.mark.parametrize("given", [{}, {"reverse": True}, {"speed": 0.4}], ids=str)
async def test_tiago_follows_a_path_round_corners(given: dict[str, object]) -> None:
    path = [Pose(1.0, 0.2), Pose(1.5, 1.0), Pose(0.5, 1.2), Pose(0.0, 0.5, 1.0)]
    tiago = Tiago()
    await tiago.follow(path, **given)
    tiago.check(path)


async def test_it_ends_where_its_odometry_says_although_that_drifts() -> None:
    tiago = Tiago()
    await tiago.set("simulation", "odometryDrift", 0.1)
    await tiago.follow([Pose(1.1, 0.0)])
    assert msgspec.json.decode(tiago.end("f").result)["error"] <= PLACE_M
    assert tiago.base.pose.x == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("mode", ["automatic", "manual"])
async def test_the_speed_scale_of_the_mode_changes_its_speed_and_not_its_path(mode: str) -> None:
    path = [Pose(0.8, 0.0), Pose(1.2, 0.6, 0.5)]
    tiago = Tiago()
    await tiago.set("mode", "mode", mode)
    await tiago.follow(path)
    tiago.check(path)


@given(seed=st.integers(0, 10_000), count=st.integers(1, 5))
@settings(max_examples=examples(40))
def test_it_follows_random_paths(seed: int, count: int) -> None:
    draw = random.Random(seed)
    path = [Pose(draw.uniform(-1.5, 1.5), draw.uniform(-1.5, 1.5), draw.uniform(-3, 3)) for _ in range(count)]

    async def follow() -> None:
        tiago = Tiago()
        await tiago.follow(path)
        tiago.check(path)

    asyncio.run(follow())
