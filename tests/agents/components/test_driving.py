"""A base that takes velocities, under its agent: what moves it, what stops it and what it does in between."""

import math

import msgspec
import pytest

from driven_base import LIMITS, Driven
from linked_fleet_agent.planar import STANDING
from linked_fleet_agent.wire.messages import Refused


async def test_it_drives_for_the_time_that_was_asked_for_and_ends_when_it_stands() -> None:
    bench = Driven()
    bench.drive("d", linear=0.5, lateral=0.25, duration=1.0)
    await bench.tick(3)
    assert bench.states("d") == ["running", "succeeded"]
    assert bench.base.sent[-1] == STANDING
    assert bench.base.at == pytest.approx((0.5, 0.25, 0.0), abs=0.02)
    assert max(map(abs, bench.decelerations)) <= LIMITS.linear_acceleration + 1e-9
    feedback = msgspec.json.decode(bench.end("d").feedback)
    assert feedback.keys() == {"linear", "lateral", "angular"}


async def test_a_newer_request_takes_over_the_speed() -> None:
    bench = Driven()
    for number in range(6):
        bench.drive(f"d{number}", linear=0.5, duration=0.5)
        await bench.tick(0.3)
    fast = bench.base.sent[30:]
    assert min(each.linear for each in fast) == pytest.approx(0.5)
    assert [bench.states(f"d{number}")[-1] for number in range(5)] == ["preempted"] * 5
    await bench.tick(1)
    assert bench.states("d5")[-1] == "succeeded"


async def test_a_stop_before_the_newer_request_has_begun_brakes_the_earlier_one() -> None:
    """The newer one is accepted and stopped within one tick."""
    bench = Driven()
    await bench.driving()
    bench.drive("e", linear=1.0, duration=1.0)
    bench.stop("s")
    await bench.tick(0.1)
    assert bench.states("s")[-1] == "running", "it has not come to rest"
    assert bench.base.sent[-1].linear < 0.5
    await bench.tick(0.4)
    assert bench.base.sent[-1] == STANDING
    assert bench.states("s")[-1] == "succeeded"
    assert (bench.states("d")[-1], bench.states("e")[-1]) == ("preempted", "cancelled")


async def test_a_request_after_a_stop_waits_until_the_base_stands() -> None:
    bench = Driven()
    await bench.driving()
    bench.stop("s")
    await bench.tick(0.02)
    bench.drive("e", linear=1.0, duration=1.0)
    await bench.tick(0.6)
    speeds = [each.linear for each in bench.base.sent]
    assert 0.0 in speeds[speeds.index(0.5) :]
    assert bench.states("s")[-1] == "succeeded"
    assert speeds[-1] > 0.2


@pytest.mark.parametrize("way", ["stop", "gateway", "protective stop", "fault"])
async def test_whatever_ends_a_motion_brakes_it_within_its_limits(way: str) -> None:
    bench = Driven()
    await bench.driving()
    if way == "fault":
        bench.base.broken = "no bus"
        await bench.tick(0.05)
        bench.base.broken = ""
    else:
        bench.interrupt(way)
    await bench.tick(0.05)
    assert bench.states("d")[-1] == "running", "it is not over until it stands"
    await bench.tick(0.5)
    assert bench.base.sent[-1] == STANDING
    assert bench.states("d")[-1] == ("cancelled" if way == "stop" else "failed")
    if way == "stop":
        assert bench.states("s")[-1] == "succeeded"
    assert max(bench.decelerations) <= LIMITS.linear_acceleration + 1e-9 or way == "fault"
    await bench.tick(1)
    assert bench.base.sent[-1] == STANDING


async def test_motors_that_take_nothing_prevent_motion_until_they_work() -> None:
    bench = Driven()
    bench.base.broken = "no bus"
    await bench.tick(0.05)
    refused = bench.operate("d", "drive", {"linear": 0.2}, component="mobile_base")
    assert isinstance(refused, Refused)
    assert refused.reason == "mobile_base: it fails: no bus"
    bench.base.broken = ""
    await bench.tick(0.05)
    bench.drive("e", linear=0.2)


async def test_the_end_of_the_agent_stops_it_at_once() -> None:
    bench = Driven()
    await bench.driving()
    bench.agent._stop_robot()  # as at the end of ``run``
    assert bench.base.sent[-1] == STANDING


async def test_a_stop_that_was_there_before_the_request_has_begun_to_drive_is_kept() -> None:
    """A request that is accepted and stopped within one tick moves nothing."""
    bench = Driven()
    bench.drive("d", linear=0.5)
    bench.stop("s")
    await bench.tick(1)
    assert bench.states("d")[-1] == "cancelled"
    assert set(bench.base.sent) == {STANDING}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"linear": 1.1}, "linear"),
        ({"angular": -2.1}, "angular"),
        ({"lateral": 0.6}, "lateral"),
        ({"duration": 1.5}, "duration"),
        ({"linear": "fast"}, "linear"),
        ({"sideways": 1}, "sideways"),
    ],
)
async def test_what_is_out_of_range_is_refused(given: dict[str, object], said: str) -> None:
    refused = Driven().operate("d", "drive", given, component="mobile_base")
    assert isinstance(refused, Refused)
    assert said in refused.reason


async def test_a_heading_is_in_the_state_frame() -> None:
    bench = Driven()
    bench.drive("d", angular=2.0, linear=0.5, duration=1.0)
    await bench.tick(0.6)
    base = bench.link.states[-1].base
    assert base is not None
    heading = 2.0 * math.atan2(base.orientation_xyzw[2], base.orientation_xyzw[3])
    assert heading == pytest.approx(bench.base.at.heading, abs=0.03)
    assert math.atan2(base.linear_m_s[1], base.linear_m_s[0]) == pytest.approx(heading, abs=1e-6)
