"""The periodic checks of the live fleet."""

import asyncio

import pytest

from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.subscriptions import live as live_module
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_state.events import Appeared
from linked_fleet_state.fleet import Change
from serving import until
from virtual.zenoh_network import ZenohNetwork

pytestmark = pytest.mark.virtual


@pytest.fixture
def live() -> Live:
    live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
    for name in "abc":
        live.fleet.apply(Appeared(name, 1), 1)
    return live


async def test_an_error_in_the_check_of_a_robot_hides_no_other(live: Live, monkeypatch: pytest.MonkeyPatch) -> None:
    failures, checked = list[str](), list[str]()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(str(context["exception"])))

    def check(robot: str, now_ns: int) -> Change | None:
        checked.append(robot)
        if robot == "b":
            raise ValueError("a defect")
        return None

    monkeypatch.setattr(live.fleet, "check_limits", check)
    async with live:
        await until(lambda: len(checked) >= 6)
    assert checked[:6] == ["a", "b", "c", "a", "b", "c"]
    assert set(failures) == {"a defect"}


async def test_other_callbacks_run_between_the_checks_of_many_robots(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    order, loop = list[str](), asyncio.get_running_loop()

    def check(robot: str, now_ns: int) -> Change | None:
        order.append(robot)
        loop.call_soon(order.append, "other")
        return None

    monkeypatch.setattr(live.fleet, "check_limits", check)
    monkeypatch.setattr(live_module, "SLICE_S", -1.0)  # each check takes longer
    async with live:
        await until(lambda: len(order) >= 6)
    assert order[:6] == ["a", "other", "b", "other", "c", "other"]
