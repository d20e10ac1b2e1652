"""Thing Descriptions of components conform to the standard, and have their events."""

import json
from collections.abc import Iterator
from typing import Any

import pytest
from rdflib import RDF, Literal, URIRef

from browser import DCTERMS, LF, ROS, TURTLE, Browser
from component_cell import Cell
from graphs import read
from running import eventually
from small_fleet import Place
from virtual.processes import serving_robot
from wot import conforms

pytestmark = pytest.mark.virtual


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cell", Cell()):
        eventually(lambda: browser.http.get(browser.root + "cell/lamp").status_code == 200, "components")
        yield browser


def _td(browser: Browser, path: str) -> dict[str, Any]:
    answer = browser.http.get(browser.root + path, headers={"accept": "application/td+json"})
    return dict(json.loads(answer.raise_for_status().content))


@pytest.mark.parametrize("path", ["cell/gripper", "cell/lamp", "cell/"])
def test_descriptions_conform_to_the_standard(browser: Browser, path: str) -> None:
    conforms(_td(browser, path))


def test_actions_say_what_they_return(browser: Browser) -> None:
    output = _td(browser, "cell/gripper")["actions"]["grasp"]["output"]["properties"]
    assert output["feedback"]["unit"] == "M"
    assert output["output"]["required"] == ["width", "holding"]


def test_the_directory_has_them_with_their_classes(browser: Browser) -> None:
    answer = browser.http.get(browser.root + "things", headers={"accept": TURTLE})
    things, gripper = read(answer.content, str(answer.url)), URIRef(browser.root + "cell/gripper")
    assert things.value(gripper, DCTERMS.title) == Literal("gripper")
    assert LF.Component in set(things.objects(gripper, RDF.type))
    assert ROS.Link not in set(things.objects(gripper, RDF.type))


def test_the_listing_has_their_descriptions(browser: Browser) -> None:
    listed = {each["id"]: each for each in browser.http.get(browser.root + "things").json()}
    assert browser.root + "cell/lamp" in listed
    assert listed[browser.root + "cell/gripper"]["events"].keys() == {"lost", "opened"}


def test_events_can_be_subscribed_to(browser: Browser) -> None:
    said = _td(browser, "cell/gripper")
    assert set(said["events"]) == {"lost", "opened"}
    lost = said["events"]["lost"]
    assert set(lost["data"]["properties"]) == {"occurrences", "resultTime", "value"}
    stream, socket = lost["forms"]
    assert stream["op"] == socket["op"] == ["subscribeevent", "unsubscribeevent"]
    assert (stream["subprotocol"], socket["subprotocol"]) == ("sse", "lf.json")
    with browser.http.stream("GET", stream["href"], headers={"accept": "text/event-stream"}) as answer:
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/event-stream")
    assert "events" not in _td(browser, "cell/lamp")


@pytest.mark.parametrize("where", ["", ".well-known/wot", "things"])
def test_the_fleet_offers_the_actions_of_members_while_they_exist(browser: Browser, where: str) -> None:
    """Of missions, here. The directory is kept, the other two are made anew."""

    def actions() -> dict[str, Any]:
        found = browser.http.get(browser.root + where, headers={"accept": "application/td+json, */*;q=0.1"}).json()
        listed = found if where == "things" else [found]
        return next(dict(each["actions"]) for each in listed if each["id"] == browser.root)

    angle = {"name": "angle", "type": "number", "minimum": 0.1}
    mission = {"title": "Nod", "parameters": [angle], "step": {"type": "wait", "seconds": 0}}
    before = actions()
    made = browser.http.post(browser.root + "missions", json=mission).headers["location"]
    name = made.removeprefix(browser.root) + "/actions/run"
    run = actions()[name]
    assert actions().keys() - before.keys() == {name}
    assert run["title"] == "Run: Nod" and run["forms"][0]["href"] == f"{made}/actions/run?as=json"
    assert run["input"]["properties"]["angle"]["minimum"] == 0.1 and run["input"]["required"] == ["angle"]
    assert browser.http.delete(made).status_code == 204
    assert actions() == before
