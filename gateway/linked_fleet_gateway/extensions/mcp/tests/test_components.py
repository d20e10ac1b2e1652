"""Language models find, read, rehearse, use and stop components."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from component_cell import Cell
from linked_fleet_agent.components import Call, Component, action
from linked_fleet_agent.robots.of_components import RobotOfComponents
from mcp_client import McpClient, mcp_session, text_of
from parallel import pool
from running import eventually
from small_fleet import Place
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual


class Magnet(Component, blocking=False, rate_hz=100):
    """A magnet."""

    held = 0

    @action()
    async def hold(self, call: Call[None]) -> None:
        """Hold what is there."""
        self.held += 1


@dataclass
class Scene:
    speaker: McpClient
    cell: Cell
    magnet: Magnet
    root: str

    def find(self, **arguments: Any) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self.speaker.call("find", **arguments)["structuredContent"]["items"]
        return found


@pytest.fixture
def scene(tmp_path: Any) -> Iterator[Scene]:
    place, cell, magnet = Place(tmp_path), Cell(), Magnet()
    with (
        place.gateway(),
        serving_robot(place.zenoh, "cell", cell),
        serving_robot(place.zenoh, "crane", RobotOfComponents("Crane", magnet)),
        mcp_session(place.root) as speaker,
    ):
        found = Scene(speaker, cell, magnet, place.root)
        eventually(lambda: len(found.find(kind="component")) == 3, "components")
        eventually(lambda: found.find(text="lamp", kind="component")[0]["now"]["count"] == 3, "values")
        yield found


def test_components_are_found_with_their_values_and_actions(scene: Scene) -> None:
    (gripper,) = scene.find(text="gripper", kind="component", robot="cell")
    assert gripper["iri"] == scene.root + "cell/gripper"
    assert (gripper["now"], gripper["types"]) == ({"width": 0.08}, ["Component"])
    assert set(gripper["values"]) == {gripper["iri"] + each for each in ("/width", "/lost", "/opened")}
    (grasp,) = scene.find(text="close the fingers", kind="action")
    assert grasp["body_schema"]["properties"]["force"]["maximum"] == 70
    assert grasp["call"] == {"tool": "act"}


def test_components_are_read_and_queried(scene: Scene) -> None:
    said = scene.speaker.call("read", target="/cell/lamp")["structuredContent"]
    assert said["colour"] == "red"
    query = "SELECT ?c { ?c a <https://w3id.org/linked-fleet#Component> }"
    rows = scene.speaker.call("query", query=query)["structuredContent"]["results"]["bindings"]
    assert {row["c"]["value"] for row in rows} == {
        scene.root + each for each in ("cell/gripper", "cell/lamp", "crane/magnet")
    }


def test_an_action_is_rehearsed_and_has_its_result(scene: Scene) -> None:
    action = "/cell/gripper/actions/grasp"
    assert scene.speaker.call("rehearse", action=action, body={"force": 20})["isError"] is False
    assert scene.cell.gripper.gap == 0.08
    done = scene.speaker.call("act", action=action, body={"force": 20})
    assert done["isError"] is False, text_of(done)
    assert done["structuredContent"]["output"] == {"width": 0.03, "holding": True}
    refused = scene.speaker.call("act", action=action, body={"force": 71})
    assert refused["isError"] is True and "70" in text_of(refused)


def test_a_property_is_set_by_its_action(scene: Scene) -> None:
    (switch,) = scene.find(text="set on", kind="action")
    assert scene.speaker.call("act", action=switch["iri"], body={"value": True})["isError"] is False
    assert scene.cell.lamp.lit


@pytest.mark.parametrize("target", ["/cell/gripper", "/cell/gripper/width", "/cell"])
def test_a_component_stops_with_its_robot(scene: Scene, target: str) -> None:
    with pool(1) as threads:
        acting = threads.submit(_act, scene, "/cell/gripper/actions/wait")
        eventually(lambda: "running" in json.dumps(_invocations(scene)), "the action runs")
        assert scene.speaker.call("stop", target=target)["isError"] is False
        assert acting.result()["structuredContent"]["state"].endswith("cancelled")


def _act(scene: Scene, action: str) -> Any:
    with mcp_session(scene.root) as other:
        return other.call("act", action=action)


def _invocations(scene: Scene) -> Any:
    return scene.speaker.call("read", target="/cell/gripper/actions/wait/invocations")


@pytest.mark.parametrize("target", ["/crane/magnet", "/crane/magnet/actions/~68old"])
def test_a_stop_does_not_run_an_action_that_has_the_name_of_one(scene: Scene, target: str) -> None:
    assert "/crane/actions/stop" in text_of(scene.speaker.call("stop", target=target))
    assert scene.magnet.held == 0
    assert scene.speaker.call("act", action="/crane/magnet/actions/~68old")["isError"] is False
    assert scene.magnet.held == 1
