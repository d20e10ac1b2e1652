"""The runs of robots that an agent process serves."""

import asyncio
import threading
from contextlib import asynccontextmanager
from typing import Any, ClassVar, Self, cast

import pytest

from linked_fleet_agent import serving
from linked_fleet_agent.robot import NewDescriptionError
from linked_fleet_agent.robots.catalogue import AwayError, UnavailableError
from linked_fleet_agent.settings import AgentSettings, RobotChoice
from linked_fleet_agent.transport import Session


class FakeAgent:
    """An agent whose run ends with ``ends`` if that is set, and else lasts."""

    name, description, has_cameras, has_components = "r", b"", False, False
    handle = handle_stop = mesh = None

    def __init__(self, ends: Exception | None) -> None:
        self._ends, self.began = ends, asyncio.Event()
        self.incarnation = 1 if ends else 2

    async def run(self, link: object) -> None:
        self.began.set()
        if self._ends is not None:
            raise self._ends
        await asyncio.Event().wait()


class Shown:
    """Stands in for the declarations of an absent robot; ``reasons`` are those that gateways could see."""

    reasons: ClassVar[list[str]] = []

    def __init__(self, session: object, keys: object, robot: str, incarnation: int, reason: str) -> None:
        self.reason = reason

    def __enter__(self) -> Self:
        Shown.reasons.append(self.reason)
        return self

    def __exit__(self, *_: object) -> None:
        Shown.reasons.append(self.reason)


async def test_a_robot_with_a_new_description_gets_another_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a link of its own, after the former one is closed, and after attempts at which it was not there yet."""
    said: list[str] = []
    later: list[Any] = [UnavailableError("r: away"), FakeAgent(None)]
    agents: list[Any] = [FakeAgent(NewDescriptionError("new"))]

    @asynccontextmanager
    async def link(*_: object, incarnation: int, **more: object) -> Any:
        said.append(f"open {incarnation}")
        try:
            yield None
        finally:
            said.append(f"close {incarnation}")

    def make(settings: AgentSettings, place: int) -> Any:
        found = later.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr(serving, "make_agent", make)
    monkeypatch.setattr(serving, "FIRST_DELAY_S", 0.0)
    monkeypatch.setattr(serving, "RobotLink", link)
    monkeypatch.setattr(serving, "AbsentRobot", Shown)
    first, second = agents[0], later[1]
    settings = AgentSettings(robots=(RobotChoice("q", "q"), RobotChoice("r", "r")))
    served = serving._Served(settings, cast(Session, None), None, agents)
    task = asyncio.create_task(served.keep_running(first, True))
    await asyncio.wait_for(second.began.wait(), 10)
    assert first.began.is_set() and agents == [second]
    assert said == ["open 1", "close 1", "open 2"]
    assert Shown.reasons == ["r: it has described itself anew", "r: away"]
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


async def test_a_robot_that_is_away_is_looked_for_at_one_rate_and_said_a_few_times(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """One that cannot be used for another reason is tried less and less often."""
    errors = [*(AwayError("r: away") for _ in range(9)), *(UnavailableError("r: unusable") for _ in range(7))]
    slept = list[float]()

    def make(settings: AgentSettings, place: int) -> Any:
        if errors:
            raise errors.pop(0)
        return FakeAgent(None)

    async def sleep(delay_s: float) -> None:
        slept.append(delay_s)

    monkeypatch.setattr(serving, "make_agent", make)
    monkeypatch.setattr(serving, "AbsentRobot", Shown)
    monkeypatch.setattr(serving.asyncio, "sleep", sleep)
    settings = AgentSettings(robots=(RobotChoice("r", "r"),))
    await serving._Served(settings, cast(Session, None), None, [])._loaded(serving.Absent(0, "r: not yet"))
    assert slept == [2.0] * 9 + [4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 60.0]
    assert sum("r: away" in each for each in caplog.messages) == 4
    assert sum("r: unusable" in each for each in caplog.messages) == 7


async def test_a_robot_that_is_found_after_the_end_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else its connection would keep the process."""
    asked, found, closed = threading.Event(), threading.Event(), asyncio.Event()

    class LateAgent(FakeAgent):
        def close(self) -> None:
            closed.set()

    def make(settings: AgentSettings, place: int) -> Any:
        asked.set()
        found.wait(10)
        return LateAgent(None)

    monkeypatch.setattr(serving, "make_agent", make)
    monkeypatch.setattr(serving, "AbsentRobot", Shown)
    settings = AgentSettings(robots=(RobotChoice("r", "r"),))
    served = serving._Served(settings, cast(Session, None), None, [])
    task = asyncio.create_task(served.wait_for(serving.Absent(0, "r: away"), True))
    await asyncio.to_thread(asked.wait, 10)
    task.cancel()
    found.set()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert closed.is_set()
