"""The action of a base that follows a path, under its agent: progress, result, and what ends it."""

import math

import msgspec
import pytest

from driven_base import Driven
from linked_fleet_agent.components.declaration import declare
from linked_fleet_agent.components.kinds import PathPose
from linked_fleet_agent.planar import STANDING, Pose
from linked_fleet_agent.wire.messages import Accepted, Refused
from paths import LEVEL_RAD, PLACE_M, off_m

ROUND = [{"x": 1, "y": 0}, {"x": 1, "y": 1, "heading": 1.5}]


class Follower(Driven):
    """A base of which every pose is kept."""

    def __init__(self) -> None:
        super().__init__()
        self.poses = [Pose()]

    async def tick(self, seconds: float = 0.01) -> None:
        for _ in range(max(1, round(seconds / 0.01))):
            await super().tick()
            self.poses.append(self.base.at)

    def follow(self, id: str = "f", path: object = ROUND, **given: object) -> object:
        return self.operate(id, "followPath", {"path": path, **given}, component="mobile_base")

    async def going(self) -> None:
        assert isinstance(self.follow(), Accepted)
        await self.tick(0.6)
        assert self.base.sent[-1].linear > 0.3


async def test_it_follows_a_path_and_says_how_near_it_came() -> None:
    bench = Follower()
    assert isinstance(bench.follow(), Accepted)
    await bench.tick(1.5)
    told = bench.link.progress[-1]
    assert 0.2 < told.progress < 0.8
    assert msgspec.json.decode(told.feedback) == pytest.approx(bench.base.at._asdict(), abs=0.15)
    await bench.tick(5)
    assert bench.states("f") == ["running", "succeeded"]
    result = msgspec.json.decode(bench.end("f").result)
    assert result["error"] <= PLACE_M
    assert result["headingError"] <= LEVEL_RAD
    assert bench.base.at == pytest.approx((1, 1, 1.5), abs=0.02)
    assert off_m(bench.poses, [Pose(), Pose(1, 0), Pose(1, 1)]) <= 0.05
    assert bench.base.sent[-1] == STANDING


async def test_it_publishes_the_poses_that_it_has_yet_to_pass() -> None:
    """Whoever drives near it keeps off these."""
    bench, seen = Follower(), list[list[object]]()
    bench.follow(path=[{"x": 0.5, "y": 0}, *ROUND])
    while not seen or bench.base.path:
        await bench.tick()
        seen += [] if seen and bench.base.path == seen[-1] else [bench.base.path]
    ends = PathPose(0.5, 0.0, 0.0), PathPose(1.0, 0.0, 0.0), PathPose(1.0, 1.0, 1.5)
    assert seen == [list(ends), list(ends[1:]), list(ends[2:]), []]


@pytest.mark.parametrize("way", ["stop", "gateway", "protective stop"])
async def test_an_interrupted_path_is_not_ahead_any_more(way: str) -> None:
    bench = Follower()
    await bench.going()
    assert bench.base.path
    bench.interrupt(way)
    await bench.tick(0.3)
    assert bench.base.path == []


async def test_a_rehearsal_says_how_long_it_takes() -> None:
    bench = Follower()
    said = bench.follow("r", speed=0.5)
    assert isinstance(said, Accepted)
    rehearsed = bench.operate(
        "r2", "followPath", {"path": ROUND, "speed": 0.5}, component="mobile_base", rehearsal=True
    )
    assert isinstance(rehearsed, Accepted)
    start = len(bench.link.states)
    while bench.states("r")[-1:] != ["succeeded"]:
        await bench.tick(0.1)
    assert (len(bench.link.states) - start) / 100 == pytest.approx(rehearsed.duration_s, rel=0.15)


@pytest.mark.parametrize("way", ["stop", "gateway", "protective stop"])
async def test_whatever_ends_it_brakes_it_within_its_limits(way: str) -> None:
    bench = Follower()
    await bench.going()
    bench.interrupt(way)
    await bench.tick(0.03)
    assert bench.states("f")[-1] == "running", "it is not over until it stands"
    await bench.tick(0.7)
    assert bench.states("f")[-1] == ("cancelled" if way == "stop" else "failed")
    assert bench.base.sent[-1] == STANDING
    assert max(bench.decelerations) <= 2.0 + 1e-9


async def test_drive_and_a_path_take_the_base_from_each_other_and_stop_in_between() -> None:
    bench = Follower()
    await bench.going()
    bench.drive("d", linear=-0.4, duration=0.5)
    await bench.tick(2)
    assert (bench.states("f")[-1], bench.states("d")[-1]) == ("preempted", "succeeded")
    bench.drive("e", linear=0.4, duration=1.0)
    await bench.tick(0.4)
    assert isinstance(bench.follow("g"), Accepted)
    await bench.tick(6)
    assert (bench.states("e")[-1], bench.states("g")[-1]) == ("preempted", "succeeded")
    assert bench.base.at == pytest.approx((1, 1, 1.5), abs=0.02)


async def test_a_newer_path_that_goes_on_ahead_takes_over_the_speed() -> None:
    bench = Follower()
    assert isinstance(bench.follow("f", [{"x": 3, "y": 0}]), Accepted)
    await bench.tick(1)
    assert isinstance(bench.follow("g", [{"x": 0, "y": 0}, {"x": 3, "y": 0.2}]), Accepted)
    await bench.tick(0.3)
    assert bench.states("f")[-1] == "preempted"
    assert min(each.linear for each in bench.base.sent[100:]) > 0.9
    await bench.tick(6)
    assert bench.states("g")[-1] == "succeeded"
    assert bench.base.at[:2] == pytest.approx((3, 0.2), abs=0.02)


async def test_a_newer_path_that_leads_elsewhere_is_begun_when_the_base_stands() -> None:
    bench = Follower()
    await bench.going()
    assert isinstance(bench.follow("g", [{"x": -0.5, "y": 0}]), Accepted)
    await bench.tick(6)
    assert bench.states("g")[-1] == "succeeded"
    assert 0.0 in [each.linear for each in bench.base.sent[60:200]]
    assert max(bench.decelerations) <= 2.0 + 1e-9


async def test_a_base_that_does_not_move_fails_with_a_reason() -> None:
    bench = Follower()
    bench.base.measure = lambda elapsed_s: (Pose(), STANDING)  # type: ignore[method-assign]
    assert isinstance(bench.follow(), Accepted)
    await bench.tick(8)
    assert bench.states("f")[-1] == "failed"
    assert bench.end("f").reason == "the base has not moved for 5 s, although it should"
    assert bench.base.sent[-1] == STANDING


async def test_a_base_that_is_pushed_away_fails_with_a_reason() -> None:
    bench = Follower()
    await bench.going()
    bench.base.at = bench.base.at._replace(y=0.5)
    await bench.tick(1)
    assert bench.states("f")[-1] == "failed"
    assert "off its path by 0.50 m" in bench.end("f").reason
    assert bench.base.sent[-1] == STANDING


@pytest.mark.parametrize(
    ("path", "more", "said"),
    [
        ([], {}, "an array of 0 items"),
        ([{"x": 0.1 * n, "y": 0} for n in range(65)], {}, "an array of 65 items"),
        ([{"x": 1}], {}, "'y' is missing"),
        ([{"x": 1e300, "y": 0}], {}, "above 10000"),
        (ROUND, {"speed": 0.01}, "below 0.05"),
        (ROUND, {"reverse": True}, "'reverse' is unknown"),
    ],
)
async def test_what_is_out_of_range_is_refused(path: object, more: dict[str, object], said: str) -> None:
    refused = Follower().follow("f", path, **more)
    assert isinstance(refused, Refused)
    assert said in refused.reason


async def test_a_path_that_takes_too_long_fails_and_moves_nothing() -> None:
    bench = Follower()
    assert isinstance(bench.follow("f", [{"x": 9000, "y": 0}]), Accepted)
    await bench.tick(0.5)
    assert bench.states("f")[-1] == "failed"
    assert "3600 s is the most" in bench.end("f").reason
    assert set(bench.base.sent) == {STANDING}


def test_its_headings_may_be_left_out_and_are_those_of_the_way() -> None:
    said = declare(Driven().base).said.actions["followPath"]
    assert said.input is not None
    assert said.input.required == ("path",)
    assert said.rehearses
    assert math.isclose(said.stop_s, declare(Driven().base).said.actions["drive"].stop_s)
