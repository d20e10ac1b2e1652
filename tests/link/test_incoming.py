"""Frames that arrive over a session, and which of them reach the event loop."""

import asyncio

import pytest

from fake_robots import KEYS, FakeRobot, open_session
from linked_fleet_link.fleet_link import FleetLink
from linked_fleet_state.events import Frames
from linked_fleet_state.fleet import Appeared, Described, Event, Fleet, Framed
from running import free_port
from serving import until
from virtual.processes import gateway_session

pytestmark = pytest.mark.virtual


class Gateway:
    """A fleet on a link, which records events."""

    def __init__(self, endpoint: str) -> None:
        self.fleet = Fleet(Frames(lambda robot: KEYS.robot(robot, "state")))
        self.events: asyncio.Queue[Event] = asyncio.Queue()
        self.link = FleetLink(
            KEYS,
            "g",
            lambda: gateway_session(endpoint),
            self._on_events,
            lambda *_: None,
            frames=self.fleet.frames,
        )

    def _on_events(self, events: list[Event]) -> None:
        for event in events:
            self.fleet.apply(event, 1)
            self.events.put_nowait(event)

    async def until(self, kind: type[Event]) -> Event:
        while not isinstance(event := await self.events.get(), kind):
            pass
        return event


async def test_frames_that_are_watched_or_unchecked_reach_the_event_loop() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    gateway = Gateway(endpoint)
    async with gateway.link:
        await gateway.link.join()
        with open_session(endpoint) as session:
            robot = FakeRobot(session, "r").appear()
            await gateway.until(Described)
            robot.put("state", robot.frame((0.1,)))
            await gateway.until(Framed)
            robot.put("state", robot.frame((0.2,)))
            await until(lambda: gateway.fleet.frames.taken >= 1)
            assert (gateway.events.empty(), gateway.fleet.robots["r"].positions["elbow"]) == (True, 0.2)
            gateway.fleet.frames.watched = {"r"}
            late = robot.frame((0.9,))
            robot.put("state", robot.frame((0.3,)))
            await until(lambda: gateway.fleet.next_moved() == "r")
            robot.put("state", late)
            assert await gateway.until(Framed) == Framed("r", late)
            assert (gateway.fleet.dropped["r"], gateway.fleet.robots["r"].positions["elbow"]) == (1, 0.3)


async def test_an_error_about_one_message_loses_no_other() -> None:
    """Tokens are announced once, so that a lost one would hide its robot."""
    failures, heard = list[Exception](), list[str]()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(context["exception"]))
    endpoint = f"tcp/127.0.0.1:{free_port()}"

    def on_events(events: list[Event]) -> None:
        for event in events:
            if isinstance(event, Appeared) and event.robot == "a":
                raise ValueError("a defect")
            if isinstance(event, Appeared):
                heard.append(event.robot)

    link = FleetLink(KEYS, "g", lambda: gateway_session(endpoint), on_events, lambda *_: None)
    async with link:
        await link.join()
        with open_session(endpoint) as session:
            robots = [FakeRobot(session, name).appear() for name in "abc"]
            await until(lambda: len(heard) == len(robots) - 1)
    assert heard == ["b", "c"]
    assert [str(each) for each in failures] == ["a defect"]
