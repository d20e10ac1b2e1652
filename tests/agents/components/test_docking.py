"""Docking under an agent: what is refused, what fails and with which sentence, and what ends it."""

import math

import msgspec
import pytest

from driven_base import LIMITS, Driven, Ideal
from linked_fleet_agent.components.declaration import declare
from linked_fleet_agent.components.kinds import Station
from linked_fleet_agent.planar import STANDING, Pose
from linked_fleet_agent.wire.messages import Accepted, Refused

EAST = Station("east", 1.0, 0.0, 0.0)


class Charging(Ideal, limits=LIMITS, docks=True):
    """A base that knows where its stations are."""

    def __init__(self, *stations: Station) -> None:
        super().__init__()
        self.stations_now = list(stations)

    def known_stations(self) -> list[Station]:
        return self.stations_now


class Dock(Driven):
    base: Charging

    def __init__(self, *stations: Station, at: Pose | None = None) -> None:
        super().__init__(Charging(*(stations or (EAST,))))
        self.base.at = at or Pose()

    def dock(self, id: str = "d", **given: object) -> object:
        return self.operate(id, "dock", given, component="mobile_base")

    async def rehearsed(self, action: str = "dock", **given: object) -> object:
        await self.tick()
        return self.operate("r", action, given or None, component="mobile_base", rehearsal=True)

    async def docked(self) -> None:
        assert isinstance(self.dock("first"), Accepted)
        await self.tick(12)
        assert self.end("first").state == "succeeded", self.end("first").reason

    @property
    def docked_at(self) -> str:
        return self.base.docked_at  # type: ignore[attr-defined, no-any-return]


async def test_it_says_how_it_goes_and_where_it_is_docked() -> None:
    bench = Dock()
    rehearsed = await bench.rehearsed()
    assert isinstance(rehearsed, Accepted)
    assert bench.docked_at == ""
    assert isinstance(bench.dock(), Accepted)
    await bench.tick(rehearsed.duration_s - 2)
    assert bench.link.progress[-1].reason == "into east"
    assert max(bench.base.sent[-1]) <= 0.1, "slowly"
    await bench.tick(3)
    assert bench.states("d") == ["running", "succeeded"]
    said = [each.progress for each in bench.link.progress]
    assert said == sorted(said)
    result = msgspec.json.decode(bench.end("d").result)
    assert (result["station"], bench.docked_at) == ("east", "east")
    assert result["error"] <= 0.01
    assert result["headingError"] <= math.radians(1)
    assert bench.base.at == pytest.approx((1, 0, 0), abs=0.01)


async def test_to_dock_where_it_is_docked_is_done_at_once_and_elsewhere_is_refused() -> None:
    bench = Dock(EAST, Station("north", 0.0, 1.0, math.pi / 2))
    assert isinstance(bench.dock("first", station="east"), Accepted)
    await bench.tick(12)
    count = len(bench.base.sent)
    bench.dock("again", station="east")
    await bench.tick(0.1)
    assert bench.states("again")[-1] == "succeeded"
    assert set(bench.base.sent[count:]) == {STANDING}
    refused = await bench.rehearsed(station="north")
    assert isinstance(refused, Refused)
    assert "docked at 'east'; undock it first" in refused.reason


async def test_undock_backs_out_straight() -> None:
    bench = Dock()
    await bench.docked()
    before = bench.base.at
    assert isinstance(bench.operate("u", "undock", None, component="mobile_base"), Accepted)
    await bench.tick(0.5)
    assert bench.docked_at == ""
    await bench.tick(6)
    assert bench.end("u").state == "succeeded"
    assert before.ahead_m(bench.base.at) == pytest.approx(-0.4, abs=0.005)
    assert bench.base.at.heading == pytest.approx(before.heading, abs=0.01)
    refused = await bench.rehearsed("undock")
    assert isinstance(refused, Refused)
    assert "the base is not docked" in refused.reason


async def test_driving_away_ends_the_contact() -> None:
    bench = Dock()
    await bench.docked()
    bench.drive("away", linear=-0.3, duration=0.2)
    await bench.tick(1)
    assert bench.docked_at == ""


@pytest.mark.parametrize(
    ("stations", "at", "given", "said"),
    [
        ((EAST,), Pose(), {"station": "west"}, "there is no station 'west'; this base knows east"),
        ((EAST, Station("west", -1, 0, math.pi)), Pose(), {}, "say at which station; this base knows east, west"),
        ((EAST,), Pose(-1.5, 0, 0), {}, "2.5 m from the station 'east'; drive it within 2 m of that first"),
        ((EAST,), Pose(1.6, 0, 0), {}, "the base is behind the station 'east'; drive it in front of that first"),
    ],
)
async def test_what_cannot_be_docked_says_why_and_moves_nothing(
    stations: tuple[Station, ...], at: Pose, given: dict[str, object], said: str
) -> None:
    bench = Dock(*stations, at=at)
    refused = await bench.rehearsed(**given)
    assert isinstance(refused, Refused)
    assert said in refused.reason
    bench.dock(**given)
    await bench.tick(0.5)
    assert bench.end("d").state == "failed"
    assert said in bench.end("d").reason
    assert set(bench.base.sent) == {STANDING}


async def test_a_missed_station_fails_and_can_be_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Dock()
    with monkeypatch.context() as broken:
        broken.setattr(bench.base, "station_in_contact", lambda: "")
        bench.dock()
        await bench.tick(12)
        assert bench.end("d").state == "failed"
        assert bench.end("d").reason.startswith("there is no contact with the station 'east': the base stands 0.00")
    bench.base.at = Pose(0.97, 0.02, 0.05)
    await bench.docked()


async def test_a_blocked_base_fails_with_a_reason() -> None:
    bench = Dock()
    bench.dock()
    await bench.tick(1)
    stuck = bench.base.at
    bench.base.measure = lambda elapsed_s: (stuck, STANDING)  # type: ignore[method-assign]
    await bench.tick(7)
    assert bench.end("d").state == "failed"
    assert "has not moved for 5 s" in bench.end("d").reason
    assert bench.base.sent[-1] == STANDING


async def test_a_station_that_vanishes_on_the_way_fails() -> None:
    bench = Dock()
    bench.dock()
    await bench.tick(0.5)
    bench.base.stations_now.clear()
    await bench.tick(6)
    assert bench.end("d").state == "failed"
    assert bench.end("d").reason.startswith("the station is not seen any more")
    assert bench.base.sent[-1] == STANDING


@pytest.mark.parametrize("into", [False, True], ids=["before it", "on the last piece"])
@pytest.mark.parametrize("way", ["stop", "gateway", "protective stop"])
async def test_what_ends_motions_ends_it_and_it_can_be_done_again(way: str, into: bool) -> None:
    bench = Dock()
    bench.dock()
    await bench.tick(0.6)
    while into and bench.link.progress[-1].reason != "into east":
        await bench.tick(0.2)
    await bench.tick(0.5)
    assert bench.base.sent[-1] != STANDING
    bench.interrupt(way)
    await bench.tick(0.7)
    assert bench.states("d")[-1] == ("cancelled" if way == "stop" else "failed")
    assert bench.base.sent[-1] == STANDING
    assert bench.docked_at == ""
    bench.base.prevents_motion, bench.link.gateway_present = "", True
    await bench.tick(0.2)
    await bench.docked()


def test_a_base_without_stations_does_not_offer_it() -> None:
    said = declare(Ideal()).said
    assert not {"dock", "undock"} & said.actions.keys()
    assert not {"stations", "dockedAt"} & said.properties.keys()
