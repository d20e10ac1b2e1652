"""A mission of ten steps on three robots, whose gateway is killed at some instant: each step is taken once."""

import asyncio
import signal
import time
from collections.abc import Iterator
from typing import Any

import pytest
import rdflib
from rdflib import URIRef

from browser import LF
from gateway_group import gateways
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.actions.store import ActionStore
from linked_fleet_gateway.api import Invocation
from mission_fleet import LASTS_S, TURNS, MissionFleet, mission_fleet
from running import eventually

pytestmark = pytest.mark.virtual
INSTANTS = [LASTS_S * number / 32 for number in range(32)]


@pytest.fixture
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MissionFleet]:
    with mission_fleet(tmp_path_factory.mktemp("redis")) as found:
        yield found


def _check(fleet: MissionFleet, at_s: float, signal_: signal.Signals) -> None:
    path, begun_s = fleet.begin(), time.monotonic()
    eventually(lambda: time.monotonic() >= begun_s + at_s, "the instant")
    fleet.one.process.send(signal_)
    fleet.succeeds(path)
    assert fleet.taken() == TURNS


@pytest.mark.parametrize("at_s", INSTANTS[::8])
def test_each_step_is_taken_once_when_a_gateway_is_killed(fleet: MissionFleet, at_s: float) -> None:
    _check(fleet, at_s, signal.SIGKILL)


@pytest.mark.test_all
@pytest.mark.parametrize("at_s", [each for number, each in enumerate(INSTANTS) if number % 8])
def test_each_step_is_taken_once_whenever_a_gateway_is_killed(fleet: MissionFleet, at_s: float) -> None:
    _check(fleet, at_s, signal.SIGKILL)


def test_a_gateway_that_ends_in_order_hands_its_runs_over(fleet: MissionFleet) -> None:
    _check(fleet, 2.0, signal.SIGTERM)


def test_a_gateway_that_was_frozen_leaves_its_runs_to_who_has_gone_on(fleet: MissionFleet) -> None:
    path, begun_s = fleet.begin(), time.monotonic()
    eventually(lambda: time.monotonic() >= begun_s + 1.0, "the first steps")
    fleet.one.process.send(signal.SIGSTOP)
    eventually(lambda: time.monotonic() >= begun_s + 25.0, "the other gateway has gone on")
    fleet.one.process.send(signal.SIGCONT)
    fleet.succeeds(path)
    assert fleet.taken() == TURNS
    run = rdflib.URIRef(fleet.other.browser.root + path)
    invocation = next(fleet.described(path).objects(run, LF.invocation))
    for each in (fleet.one, fleet.other):
        ends = URIRef(each.here(str(invocation)))
        eventually(
            lambda each=each, ends=ends: each.browser.page(str(ends)).one(LF.state) == LF.succeeded,  # type: ignore[misc]
            "the end of the invocation",
        )


def test_a_gateway_that_has_just_begun_goes_on_once_it_knows_the_robots(fleet: MissionFleet) -> None:
    """A gateway of a program that was started again takes over a run, and meets its robots later."""
    steps = [{"type": "wait", "seconds": 4}, fleet.turn("a", 0.1)]
    path = fleet.begin_with({"type": "sequence", "steps": steps})
    for each in (fleet.one, fleet.other):
        each.process.send(signal.SIGTERM)
    fleet.agents.send(signal.SIGSTOP)
    with gateways(fleet.hub, fleet.memory.url, 1) as (third,):
        _lasts(20.0)
        fleet.agents.send(signal.SIGCONT)
        fleet.succeeds(path, third)


def _lasts(seconds: float) -> None:
    begun_s = time.monotonic()
    eventually(lambda: time.monotonic() >= begun_s + seconds, "the time has passed")


@pytest.mark.parametrize("away_s", [0.5, 3.0, 20.0])
def test_each_step_is_taken_once_when_redis_is_away_for_a_while(fleet: MissionFleet, away_s: float) -> None:
    path = fleet.begin()
    for number in range(3):
        _lasts(2.0 + number)
        fleet.memory.kill()
        _lasts(away_s)
        fleet.memory.start()
    fleet.succeeds(path)
    assert fleet.taken() == TURNS


@pytest.mark.parametrize("waits_s", [1.5, 2.5, 4.0])
def test_a_step_that_waits_for_redis_is_not_late(
    fleet: MissionFleet, monkeypatch: pytest.MonkeyPatch, waits_s: float
) -> None:
    """Redis answers late while a replica takes over. The request of a person would be too old then."""
    create = ActionStore.create

    async def waits(self: ActionStore, invocation: Invocation, **more: Any) -> str | None:
        await asyncio.sleep(waits_s)
        return await create(self, invocation, **more)

    path = fleet.begin()
    monkeypatch.setattr(ActionStore, "create", waits)
    fleet.succeeds(path)
    assert fleet.taken() == TURNS


@pytest.mark.parametrize("sent", [False, True])
def test_a_step_is_taken_once_when_its_gateway_dies_as_it_sends_the_command(
    fleet: MissionFleet, monkeypatch: pytest.MonkeyPatch, sent: bool
) -> None:
    """Nobody knows then if the robot has got it: the robot is asked."""
    send, killed = Actions._send, list[str]()

    async def dies(self: Actions, invocation: Invocation, command: Any) -> Any:
        last = invocation.robot == "c" and not killed
        if last and not sent:
            killed.append(invocation.id)
            fleet.one.process.send(signal.SIGKILL)
            await asyncio.sleep(10_000)
        reply = await send(self, invocation, command)
        if last:
            killed.append(invocation.id)
            fleet.one.process.send(signal.SIGKILL)
            await asyncio.sleep(10_000)
        return reply

    monkeypatch.setattr(Actions, "_send", dies)
    path = fleet.begin()
    fleet.succeeds(path)
    assert fleet.taken() == TURNS
    url = f"{fleet.other.browser.root}c/wrist_3_joint/actions/rotate/invocations/{killed[0]}"
    page = fleet.other.browser.page(url)
    assert page.one(LF.state) == (LF.succeeded if sent else LF.failed)
    assert {str(each) for each in fleet.described(path).objects(None, LF.attempt)} == ({"1"} if sent else {"1", "2"})
