"""Components in Foxglove: channels of JSON for their values and events, and a service for each action."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import jsonschema
import pytest

from component_cell import Cell, Grasped
from foxglove_client import Client, connected
from linked_fleet_agent.components import Component, value
from linked_fleet_agent.robots.of_components import RobotOfComponents
from small_fleet import Place
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
GRIPPER, LAMP, LOST = "/cell/gripper", "/cell/lamp", "/cell/gripper/lost"


class Tf(Component, blocking=False, rate_hz=100):
    """A component with the name of a channel."""

    @value
    def turns(self) -> int:
        return 7


@dataclass
class Scene:
    cell: Cell
    place: Place
    client: Client

    def until(self, topic: str, wanted: Any) -> None:
        """Wait for a message, each of which conforms to the schema of its channel."""
        channel = self.client.channels[topic]
        while self.message(topic, channel) != wanted:
            pass

    def message(self, topic: str, channel: dict[str, Any]) -> Any:
        said = self.client.json_message(self.topics.index(topic))
        jsonschema.validate(said, json.loads(channel["schema"]))
        return said

    topics = (GRIPPER, LAMP, LOST)


@pytest.fixture
def scene(tmp_path: Any) -> Iterator[Scene]:
    place, cell = Place(tmp_path), Cell()
    with (
        place.gateway(),
        serving_robot(place.zenoh, "cell", cell),
        serving_robot(place.zenoh, "crane", RobotOfComponents("Crane", Tf())),
        connected(place.root) as client,
    ):
        client.subscribe(*Scene.topics)
        yield Scene(cell, place, client)


def test_values_are_sent_as_they_change(scene: Scene) -> None:
    scene.until(GRIPPER, {"width": 0.08})
    scene.until(LAMP, {"on": False, "colour": "red", "pieces": [{"label": "nut", "size": 0.5}], "count": 3})
    scene.cell.gripper.gap = 0.07
    scene.until(GRIPPER, {"width": 0.07})


def test_an_unknown_value_is_left_out(scene: Scene) -> None:
    scene.until(GRIPPER, {"width": 0.08})
    scene.cell.gripper.broken = "no bus"
    scene.until(GRIPPER, {})


def test_events_are_sent(scene: Scene) -> None:
    scene.until(LOST, {"occurrences": 0})
    scene.until(GRIPPER, {"width": 0.08})
    scene.cell.gripper.lost(Grasped(0.03, False))
    said = scene.message(LOST, scene.client.channels[LOST])
    assert (said["occurrences"], said["value"]) == (1, {"width": 0.03, "holding": False})


def test_actions_are_services(scene: Scene) -> None:
    scene.until(GRIPPER, {"width": 0.08})
    scene.client.call("/cell/gripper/grasp", b'{"force": 71}')
    failure = scene.client.next("serviceCallFailure")
    assert failure["message"].startswith("422") and "70" in failure["message"]
    service = scene.client.services["/cell/gripper/grasp"]["request"]
    assert json.loads(service["schema"])["properties"]["force"]["maximum"] == 70
    scene.client.call("/cell/gripper/grasp", b'{"force": 20}')
    scene.until(GRIPPER, {"width": 0.03})
    scene.client.call("/cell/lamp/on", b'{"value": true}', id=8)
    scene.client.until(lambda: len(scene.client.responses) == 2)
    assert scene.cell.lamp.lit


def test_a_component_does_not_take_the_channel_of_another_thing(scene: Scene) -> None:
    tf = scene.client.until(lambda: scene.client.channels.get("/crane/tf~part"))
    assert (tf["encoding"], tf["schemaEncoding"], tf["schemaName"]) == ("json", "jsonschema", "crane/tf")
    assert scene.client.channels["/crane/tf"]["schemaEncoding"] == "protobuf"


def test_a_component_that_its_robot_declares_no_more_has_no_channel(tmp_path: Any) -> None:
    place = Place(tmp_path)
    with place.gateway(), connected(place.root) as client:
        with serving_robot(place.zenoh, "cell", Cell()):
            client.until(lambda: GRIPPER in client.channels)
        with serving_robot(place.zenoh, "cell", RobotOfComponents("Cell", Tf())):
            client.until(lambda: GRIPPER not in client.channels and "/cell/tf~part" in client.channels)
