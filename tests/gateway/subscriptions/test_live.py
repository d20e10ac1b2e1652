"""The periodic work of the live fleet."""

import asyncio

import pytest

from linked_fleet_gateway.app.application import new_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.fleet.fleet import Change
from serving import until
from virtual.zenoh_network import ZenohNetwork

pytestmark = pytest.mark.virtual


async def test_limits_are_watched_again_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    failures, judged = list[Exception](), list[int]()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(context["exception"]))
    live = new_live(GatewaySettings(), ZenohNetwork().gateway("g"))

    def judge(now_ns: int) -> list[Change]:
        judged.append(now_ns)
        if len(judged) == 2:
            raise ValueError("a defect")
        return []

    monkeypatch.setattr(live.fleet, "check_limits", judge)
    async with live:
        await until(lambda: len(judged) == 4)
    assert [str(each) for each in failures] == ["a defect"]
