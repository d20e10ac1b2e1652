"""A Foxglove client as a black box: it lists channels, decodes messages, calls a service, and is refused."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from authenticated_gateway import SEEN, AuthenticatedGateway, run_authenticated
from linked_fleet_gateway.extensions.foxglove.protocol import SUBPROTOCOLS
from wot import printed

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        one.add("watcher", "read", "subscribe", robots=("lab-*",))
        one.known("watcher")
        yield one


def said_by(here: AuthenticatedGateway, name: str, subprotocol: str, messages: int) -> dict[str, Any]:
    """Return the client's output, by its words."""
    url = here.root.replace("http", "ws", 1) + "foxglove"
    script = Path(__file__).with_name("foxglove.cjs")
    return printed(script, url, here.tokens[name], SEEN, subprotocol, str(messages))


@pytest.mark.parametrize(("subprotocol", "messages"), [(SUBPROTOCOLS[0], 1000), (SUBPROTOCOLS[1], 50)])
def test_a_client_lists_channels_decodes_six_schemas_and_calls_a_service(
    here: AuthenticatedGateway, subprotocol: str, messages: int
) -> None:
    said = said_by(here, "root", subprotocol, messages)
    assert {f"/{SEEN}/joint_states", "/hall-1/tf", "/world/objects"} <= set(said["channels"])
    assert said["count"] >= messages and len(said["decoded"]) == 6
    states = said["decoded"]["foxglove.JointStates"]
    assert states["joints"][0]["name"] == "shoulder_pan_joint"
    assert said["decoded"][f"/{SEEN}/mode"]["mode"] == "automatic", "a component"
    assert said["response"]["status"] == 204


def test_a_client_without_the_right_is_refused_and_sees_no_other_robots(here: AuthenticatedGateway) -> None:
    said = said_by(here, "watcher", SUBPROTOCOLS[0], 1000)
    assert str(said["failure"]).startswith("403")
    assert not [topic for topic in said["channels"] if "hall-1" in topic]
