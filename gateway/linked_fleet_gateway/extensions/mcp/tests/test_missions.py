"""Language models plan, run, watch, pause and cancel missions."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from component_cell import Cell
from mcp_client import McpClient, mcp_session, text_of
from running import eventually
from small_fleet import Place
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual


@dataclass
class Scene:
    speaker: McpClient
    cell: Cell
    root: str

    def found(self, **arguments: Any) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = self.speaker.call("find", **arguments)["structuredContent"]["items"]
        return items

    def write(self, *steps: dict[str, Any], **arguments: Any) -> dict[str, Any]:
        colour = {"name": "colour", "type": "text", "options": ["green", "red"]}
        sequence = {"type": "sequence", "steps": [self.paint({"variable": "colour"}), *steps]}
        mission = {"title": "Paint", "parameters": [colour], "step": sequence}
        return self.speaker.call("write", body=mission, **arguments)

    def paint(self, colour: object) -> dict[str, Any]:
        return {"type": "invoke", "action": f"{self.root}cell/lamp/actions/paint", "body": {"colour": colour}}

    def run(self, **arguments: Any) -> dict[str, Any]:
        (action,) = self.found(text="run paint", kind="action")
        return self.speaker.call("act", action=action["iri"], body={"colour": "green"}, **arguments)

    def read(self, iri: str) -> dict[str, Any]:
        found: dict[str, Any] = self.speaker.call("read", target=iri)["structuredContent"]
        return found


@pytest.fixture
def scene(tmp_path: Any) -> Iterator[Scene]:
    place, cell = Place(tmp_path), Cell()
    with place.gateway(), serving_robot(place.zenoh, "cell", cell), mcp_session(place.root) as speaker:
        found = Scene(speaker, cell, place.root)
        eventually(lambda: found.found(text="paint", kind="action"), "the actions of components")
        yield found


def test_a_mission_is_checked_until_it_is_to_be_kept(scene: Scene) -> None:
    (container,) = [each for each in scene.found(kind="container") if each["iri"] == scene.root + "missions"]
    assert container["call"] == {"tool": "write"}
    assert "invoke" in container["body_schema"]["properties"]["step"]["properties"]["type"]["enum"]
    refused = scene.write(scene.paint("blue"))
    assert refused["isError"] and "'blue' must be one of" in text_of(refused)
    checked = scene.write()
    assert not checked["isError"] and "Nothing has changed" in text_of(checked)
    assert scene.found(kind="member", text="paint") == []
    kept = scene.write(keep=True)
    assert kept["structuredContent"]["title"] == "Paint"
    (member,) = scene.found(kind="member", text="paint")
    assert (member["iri"], member["type"]) == (kept["structuredContent"]["iri"], "Mission")


def test_a_kept_mission_is_replaced_and_run(scene: Scene) -> None:
    iri = scene.write(keep=True)["structuredContent"]["iri"]
    scene.write(scene.paint("red"), target=iri, keep=True)
    result = scene.run()
    assert not result["isError"], text_of(result)
    run = scene.read(f"/mission-runs/{result['structuredContent']['id']}")
    assert [each["state"] for each in run["steps"]] == ["succeeded", "succeeded"]
    assert scene.cell.lamp.hue == "red"


def test_a_run_is_paused_answered_and_cancelled(scene: Scene) -> None:
    scene.write({"type": "confirm", "text": "Is it green?"}, {"type": "confirm", "text": "Go on?"}, keep=True)
    begun = scene.run(wait_s=1)
    assert "It has not ended" in text_of(begun)
    run = f"/mission-runs/{begun['structuredContent']['id']}"
    eventually(lambda: scene.read(run)["steps"][-1]["state"] == "waiting", "the question")
    assert not scene.speaker.call("act", action=f"{run}/actions/pause")["isError"]
    assert scene.read(run)["state"] == "paused"
    assert not scene.speaker.call("act", action=f"{run}/actions/resume")["isError"]
    answer = {"step": "0.1", "confirmed": True}
    assert not scene.speaker.call("act", action=f"{run}/actions/confirm", body=answer)["isError"]
    eventually(lambda: scene.read(run)["steps"][-1]["step"] == "0.2", "the next question")
    assert not scene.speaker.call("stop", target=scene.read(run)["invocation"])["isError"]
    eventually(lambda: scene.read(run)["state"] == "cancelled", "the end")
