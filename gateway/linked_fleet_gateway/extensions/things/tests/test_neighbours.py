"""The Web of Things by its standards: descriptions, their forms, and the directory."""

import json
from collections.abc import Iterator
from urllib.parse import quote

import httpx
import pytest

from connections import websocket
from running import PATIENCE_S, eventually
from small_fleet import Place, live
from wot import conforms, fits

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"
TD = {"accept": "application/td+json"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), place.ur5():
        live(browser, "ur5")
        yield place


@pytest.fixture
def http(place: Place) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=place.root, timeout=PATIENCE_S) as http:
        yield http


def _joint(http: httpx.Client) -> dict:
    """Return a revolute joint, found only by links."""
    pending = ["/.well-known/wot"]
    while pending:
        answer = http.get(pending.pop(), headers=TD)
        assert answer.headers["content-type"] == TD["accept"]
        td = answer.json()
        conforms(td)
        if "rotate" in td["actions"]:
            return td
        pending += [link["href"] for link in td["links"] if link["rel"] == "item"]
    raise AssertionError("no joint turns")


def test_bodies_that_the_schema_refuses_are_refused_by_the_shape(http: httpx.Client) -> None:
    rotate = _joint(http)["actions"]["rotate"]
    href = rotate["forms"][0]["href"]
    for body in ({"value": 100, "unit": RAD}, {"value": 0.1}, {"value": 0.1, "unit": RAD, "speedScale": 2}):
        assert not fits(body, rotate["input"])
        answer = http.post(href, json=body)
        assert answer.status_code == 422 and answer.headers["content-type"] == "application/problem+json"
    misspelt = http.post(href, json={"value": 0.1, "unit": RAD, "sped": 1})
    assert misspelt.status_code == 422 and "speedScale" in misspelt.json()["detail"]
    assert http.post(href, content=b"{", headers={"content-type": "application/json"}).status_code == 400
    assert "application/json" in http.options(href).headers["accept-post"]


def test_an_invocation_is_queried_and_cancelled_by_its_forms(http: httpx.Client) -> None:
    rotate = _joint(http)["actions"]["rotate"]
    invoke, query, cancel = (
        next(form for form in rotate["forms"] if form["op"] == op)
        for op in ("invokeaction", "queryaction", "cancelaction")
    )
    headers = {each["htv:fieldName"]: each["htv:fieldValue"] for each in invoke["htv:headers"]}
    body = {"value": 1.5, "unit": RAD, "speedScale": 0.05}
    begun = http.post(invoke["href"], json=body, headers=headers | {"accept": "application/json"})
    assert begun.status_code == 201 and fits(begun.json(), rotate["output"])
    at, stop = (form["href"].replace("{id}", begun.json()["id"]) for form in (query, cancel))
    json_only = {"accept": query["contentType"]}
    assert fits(http.get(at, headers=json_only).json(), rotate["output"])
    assert http.request(cancel["htv:methodName"], stop).status_code == 204
    state = "https://w3id.org/linked-fleet#cancelled"
    eventually(lambda: http.get(at, headers=json_only).json()["state"] == state, "the end of the motion")


def test_a_target_and_a_setting_are_written(http: httpx.Client) -> None:
    joint = _joint(http)
    target = next(form for form in joint["properties"]["targetRotation"]["forms"] if form["op"] == "writeproperty")
    value = {"value": {"value": 0.3, "unit": RAD}}
    assert fits(value, joint["properties"]["targetRotation"])
    assert http.put(target["href"], json=value).status_code == 204
    assert http.get(target["href"], headers={"accept": "application/json"}).json() == value
    robot = http.get(next(link["href"] for link in joint["links"] if link["rel"] == "collection")).json()
    title = next(form["href"] for form in robot["properties"]["title"]["forms"] if form["op"] == "writeproperty")
    assert http.put(title, json={"value": "Harry"}).status_code == 204
    assert http.get(title, params={"as": "json"}).json() == {"value": "Harry"}


def test_the_directory_is_read_by_links(http: httpx.Client) -> None:
    root = http.get("/")
    assert "/things>" in root.headers["link"]
    fleet = http.get("/.well-known/wot").json()
    assert "ThingDirectory" in fleet["@type"]
    listing = fleet["properties"]["things"]["forms"][0]["href"].partition("{")[0]
    found, url = [], f"{listing}?limit=10"
    while url:
        page = http.get(url)
        assert page.headers["content-type"] == "application/ld+json" and len(page.json()) <= 10
        found += page.json()
        url = page.links.get("next", {}).get("url")
    ids = [each["id"] for each in found]
    assert len(set(ids)) == len(ids) > 15
    for td in found:
        conforms(td)
    assert ids == sorted(ids) == [each["id"] for each in http.get(listing).json()]
    assert http.get(listing, params={"sort_by": "created"}).status_code == 501
    assert http.head(listing).content == b""
    again = http.get(f"{listing}/{quote(ids[-1], safe='')}")
    assert again.json()["id"] == ids[-1] and again.headers["content-type"] == TD["accept"]
    assert http.get(f"{listing}?limit=x").status_code == 400
    assert http.get(f"{listing}/{quote('http://elsewhere.example/', safe='')}").status_code == 404


def test_events_are_in_the_media_type_that_the_form_names(http: httpx.Client) -> None:
    rotation = _joint(http)["properties"]["rotation"]
    form = next(each for each in rotation["forms"] if each.get("subprotocol") == "sse")
    with http.stream("GET", form["href"], headers={"accept": "text/event-stream"}) as events:
        first = next(line for line in events.iter_lines() if line.startswith("data: "))
    assert fits(json.loads(first.removeprefix("data: ")), rotation)
    unknown = http.get(form["href"].replace("json", "nothing"), headers={"accept": "text/event-stream"})
    assert unknown.status_code == 406
    form = next(each for each in rotation["forms"] if each["href"].startswith("ws://"))
    with websocket("http" + form["href"].removeprefix("ws"), {}, form["subprotocol"]) as socket:
        assert fits(json.loads(socket.recv(PATIENCE_S)), rotation)
