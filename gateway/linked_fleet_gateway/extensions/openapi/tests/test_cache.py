"""Descriptions are cached by what they are made from."""

import asyncio
from types import MappingProxyType
from typing import Any

import pytest

from linked_fleet_agent.wire.components import read_declarations
from linked_fleet_gateway.extensions.components.part import parts_from
from linked_fleet_gateway.extensions.components.state import RobotState
from linked_fleet_gateway.extensions.openapi.extension import Documents
from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_identity.rights import ALL
from linked_fleet_runtime import background
from linked_fleet_state.invocations import Invocations

PAN, TILT = {"pan": ("continuous", "")}, {"tilt": ("continuous", "")}


@pytest.mark.parametrize("turns", range(1, 6))
async def test_a_robot_that_changes_while_a_description_is_made_spoils_no_later_one(
    bench: Any, monkeypatch: pytest.MonkeyPatch, turns: int
) -> None:
    bench.robot(PAN)
    view = RequestView(bench.base, MappingProxyType(bench.fleet.robots), InvocationsInView(Invocations(), ALL), ALL)
    whole = await Documents([]).document(view)
    monkeypatch.setattr(background, "SLICE_S", -1.0)
    documents = Documents([])
    making = asyncio.create_task(documents.document(view))
    for _ in range(turns):
        await asyncio.sleep(0)
    bench.robot(TILT)
    await making
    bench.robot(PAN)
    assert await Documents([]).document(view) == whole
    assert await documents.document(view) == whole


async def test_components_that_come_later_are_described(bench: Any) -> None:
    robot = bench.robot(PAN)
    view = RequestView(bench.base, MappingProxyType(bench.fleet.robots), InvocationsInView(Invocations(), ALL), ALL)
    documents = Documents([])
    assert b"brightness" not in (await documents.document(view)).body
    declared = b'[{"name": "lamp", "properties": {"brightness": {"schema": {"type": "number"}}}}]'
    components, _ = read_declarations(declared, robot.model.links, robot.model.joints)
    robot.set_parts(parts_from(robot, robot.model, components, RobotState(components, 1)), ())
    assert b"brightness" in (await documents.document(view)).body
