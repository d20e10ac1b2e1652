"""The search, while the robots that it finds change."""

from types import MappingProxyType, SimpleNamespace
from typing import Any

import pytest

from linked_fleet_gateway.extensions.mcp.read_tools import Find
from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_identity.rights import ALL, EVERYBODY
from linked_fleet_runtime import background
from linked_fleet_state.invocations import Invocations

JOINTS = {"pan": ("continuous", ""), "tilt": ("continuous", "")}


@pytest.mark.parametrize("rejected", [True, False])
@pytest.mark.parametrize("turns", range(25))
async def test_a_robot_that_changes_during_the_search_does_not_end_it(
    bench: Any, monkeypatch: pytest.MonkeyPatch, rejected: bool, turns: int
) -> None:
    robot = bench.robot(JOINTS)
    view = RequestView(bench.base, MappingProxyType(bench.fleet.robots), InvocationsInView(Invocations(), ALL), ALL)
    branches = SimpleNamespace(containers=[])
    core = SimpleNamespace(live=SimpleNamespace(branches=branches))
    context: Any = SimpleNamespace(view=view, request=SimpleNamespace(caller=EVERYBODY), core=core)
    monkeypatch.setattr(background, "SLICE_S", -1.0)
    usual, left = background.asyncio.sleep, [turns]

    async def sleep(delay_s: float) -> None:
        left[0] -= 1
        if left[0] == 0:
            robot.reject_description("it is none") if rejected else bench.robot({"pan": ("continuous", "")})
        await usual(delay_s)

    monkeypatch.setattr(background.asyncio, "sleep", sleep)
    found = await Find.model_validate({"limit": 50}).run(context, None)  # type: ignore[arg-type]
    assert found.structured_content is not None
    assert found.structured_content["items"][0]["kind"] == "robot"
