"""Operations that extensions describe: they are there, with the methods that are said and no others."""

import json
from collections.abc import Iterator
from typing import Any

import pytest

from browser import Browser
from camera_robot import EYE, CameraRobot
from fake_robots import FakeRobot, open_session
from floor_maps import WALL, pgm, upload
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
METHODS = ("get", "put", "post", "patch", "delete")
EXTENSIONS = ("/world", "/rules", "/query", "/things", "/{robot}/history", "/{robot}/cameras")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), open_session(place.zenoh) as session:
        CameraRobot(FakeRobot(session, "seer")).appear(EYE)
        live(browser, "seer")
        yield browser


@pytest.fixture(scope="module")
def paths(browser: Browser) -> dict[str, Any]:
    answer = browser.http.get(browser.root + "openapi.json", headers={"accept": "application/json"})
    return dict(answer.json()["paths"])


def made(browser: Browser, paths: dict[str, Any], container: str) -> str:
    """The id of what the example of a description makes."""
    ((kind, body),) = paths[container]["post"]["requestBody"]["content"].items()
    (example,) = body["examples"].values()
    url, content = browser.root + container[1:], json.dumps(example["value"])
    answer = browser.http.post(url, content=content, headers={"content-type": kind})
    assert answer.status_code == 201, answer.text
    return str(answer.headers["location"]).rpartition("/")[2]


def test_every_extension_describes_its_operations(paths: dict[str, Any]) -> None:
    assert set(EXTENSIONS) <= paths.keys()


def test_described_paths_exist_with_the_described_methods(browser: Browser, paths: dict[str, Any]) -> None:
    assert upload(browser.http, browser.root + "world/map", pgm([[WALL]])).status_code == 204
    known = {"object": made(browser, paths, "/world/objects"), "rule": made(browser, paths, "/rules")}
    for template, item in paths.items():
        if not template.startswith((*EXTENSIONS, "/{robot}/{part}/{property}/history")):
            continue
        path = template
        for each in item.get("parameters", ()):
            name = each["name"]
            path = path.replace(f"{{{name}}}", known.get(name) or each["schema"]["enum"][0])
        if "{part}" in template:
            path = path.replace("/elbow/pose", "/elbow/rotation")
        answer = browser.http.options(browser.root + path[1:])
        allowed = {each.strip().lower() for each in answer.headers["allow"].split(",")} - {"head", "options"}
        assert allowed == item.keys() & set(METHODS), template


def test_an_object_in_plain_json_is_an_obstacle_unless_it_says_that_it_is_a_zone(
    browser: Browser, paths: dict[str, Any]
) -> None:
    ((kind, body),) = paths["/world/objects"]["post"]["requestBody"]["content"].items()
    (example,) = body["examples"].values()
    zone = "https://w3id.org/linked-fleet#KeepOutZone"
    for more, said in (({}, "lf:Obstacle"), ({"kind": zone}, "lf:KeepOutZone")):
        content = json.dumps(example["value"] | more)
        answer = browser.http.post(browser.root + "world/objects", content=content, headers={"content-type": kind})
        assert answer.status_code == 201, answer.text
        assert said in browser.http.get(answer.headers["location"], headers={"accept": "text/turtle"}).text
        changed = browser.http.put(
            answer.headers["location"],
            content=json.dumps(example["value"] | {"title": "other"}),
            headers={"content-type": kind},
        )
        assert changed.status_code == 204, changed.text


@pytest.mark.parametrize(
    ("more", "word"),
    [({"kind": "x"}, "type"), ({"colour": 1}, "colour"), ({"title": 5}, "title"), ({"kind": [1]}, "kind")],
)
def test_an_object_in_plain_json_that_is_wrong_is_refused_with_the_reason(
    browser: Browser, paths: dict[str, Any], more: dict[str, object], word: str
) -> None:
    ((kind, body),) = paths["/world/objects"]["post"]["requestBody"]["content"].items()
    (example,) = body["examples"].values()
    content = json.dumps(example["value"] | more)
    answer = browser.http.post(browser.root + "world/objects", content=content, headers={"content-type": kind})
    assert answer.status_code == 422 and word in answer.text


def described(browser: Browser) -> dict[str, Any]:
    return dict(browser.http.get(browser.root + "openapi.json", headers={"accept": "application/json"}).json())


def inputs(document: dict[str, Any], path: str) -> list[dict[str, Any]]:
    """Return the alternatives of the body of POST of a path, resolved."""
    schema = document["paths"][path]["post"]["requestBody"]["content"]["application/json"]["schema"]
    while "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    return list(schema.get("anyOf", [schema]))


def test_actions_of_single_members_are_described_while_they_exist(browser: Browser) -> None:
    run = "/missions/{id}/actions/run"
    assert run not in described(browser)["paths"]
    made = []
    for name, least in (("angle", 0.1), ("width", 0.2)):
        parameter = {"name": name, "type": "number", "minimum": least}
        mission = {"title": name, "parameters": [parameter], "step": {"type": "wait", "seconds": 0}}
        made.append(browser.http.post(browser.root + "missions", json=mission).headers["location"])
    document = described(browser)
    item = document["paths"][run]
    assert item["parameters"][0]["schema"]["enum"] == sorted(each.rpartition("/")[2] for each in made)
    found = {next(iter(each["properties"])): each for each in inputs(document, run)}
    assert found.keys() == {"angle", "width"}
    assert found["width"]["properties"]["width"]["minimum"] == 0.2 and found["width"]["required"] == ["width"]
    for each in made:
        assert browser.http.delete(each).status_code == 204
    assert run not in described(browser)["paths"]
