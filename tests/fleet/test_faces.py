"""Faces of the whole fleet beside a robot that cannot be described: they name it, and describe the others."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from browser import Browser
from fake_robots import SIMPLE, FakeRobot, open_session
from linked_fleet_state.model import RobotModel
from mcp_client import mcp_session
from running import eventually
from small_fleet import Place, presence

pytestmark = pytest.mark.virtual
PLANTED = "a planted error"
HUGE = SIMPLE.replace('lower="-1" upper="1"', 'lower="-1.797e308" upper="1.797e308"').replace("synthetic", "huge")
BROKEN = SIMPLE.replace("synthetic", "broken")


class _Broken(RobotModel):
    """A model that raises an error whenever it is read, once it is ``armed``."""

    armed = False

    def __getattribute__(self, name: str) -> Any:
        if name in ("joints", "links", "root") and _Broken.armed:
            raise RuntimeError(PLANTED)
        return super().__getattribute__(name)


@dataclass
class Scene:
    """A fleet with a robot ``good`` and one whose name is ``bad``."""

    browser: Browser
    bad: str


@pytest.fixture(scope="module", params=["huge", "broken"])
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    """Return the fleet of a robot ``good`` and one with the name of the parameter."""
    kind, place, usual = request.param, Place(tmp_path_factory.mktemp("faces")), RobotModel.for_urdf
    models = pytest.MonkeyPatch()
    models.setattr(RobotModel, "for_urdf", lambda urdf: _Broken.parse(urdf) if urdf == BROKEN else usual(urdf))
    with models.context(), place.gateway() as (_, browser), open_session(place.zenoh) as session:
        FakeRobot(session, "good").appear().stand(0.5)
        bad = FakeRobot(session, kind)
        bad.appear(bad.description(HUGE if kind == "huge" else BROKEN)).stand(0.5)
        for name in ("good", kind):
            eventually(lambda name=name: presence(browser, name), f"the robot {name}")
        _Broken.armed = True
        yield Scene(browser, kind)
        _Broken.armed = False
    models.undo()


# Path, media type, and the format in which the bad robot has its reason.
FACES = [
    ("", "text/turtle", "listed"),
    ("", "application/ld+json", "listed"),
    ("", "text/html", "listed"),
    ("", "application/td+json", "listed"),
    ("linkset", "application/linkset+json", "listed"),
    ("openapi.json", "application/json", "reason"),
    ("things", "application/json", "reason"),
    ("things?limit=50", "application/json", "reason"),
    ("things", "text/turtle", "listed"),
    ("things", "text/html", "listed"),
    ("world", "text/turtle", "reason"),
    ("world", "text/html", "listed"),
    ("history", "text/turtle", "listed"),
    ("history", "text/html", "listed"),
    ("metrics", "text/plain", "listed"),
    ("health/ready", "application/json", "served"),
    ("rules", "text/html", "served"),
    ("query", "text/html", "served"),
    ("world/collisions", "text/html", "served"),
]


@pytest.mark.parametrize(("path", "accept", "how"), FACES, ids=[f"{path} {accept}" for path, accept, _ in FACES])
def test_a_face_names_the_robot_and_describes_the_others(scene: Scene, path: str, accept: str, how: str) -> None:
    answer = scene.browser.http.get(scene.browser.root + path, headers={"accept": accept})
    assert answer.status_code == 200, answer.text
    if how != "served":
        assert scene.bad in answer.text and "good" in answer.text
    if how == "reason" and scene.bad == "broken":
        assert PLANTED in answer.text


def test_all_things_of_the_others_are_listed(scene: Scene) -> None:
    things = scene.browser.http.get(scene.browser.root + "things", headers={"accept": "application/json"}).json()
    paths = {each["id"].removeprefix(scene.browser.root) for each in things}
    assert {"", "good/", "good/elbow", "good/base", "good/tip", f"{scene.bad}/"} <= paths
    (bad,) = (each for each in things if each["id"].endswith(f"/{scene.bad}/"))
    if scene.bad == "broken":
        assert PLANTED in bad["description"] and "properties" not in bad
        assert {"@context", "title", "security", "securityDefinitions"} <= bad.keys()


def test_the_operations_of_the_others_are_described(scene: Scene) -> None:
    said = scene.browser.http.get(scene.browser.root + "openapi.json", headers={"accept": "application/json"}).json()
    assert "/{robot}/{joint}/actions/rotate" in said["paths"]
    assert (scene.bad in said.get("x-not-described", {})) == (scene.bad == "broken")


def test_models_find_the_others_and_hear_of_the_robot(scene: Scene) -> None:
    with mcp_session(scene.browser.root) as one:
        found = one.call("find", limit=50)["structuredContent"]["items"]
        assert any(each["iri"].endswith("/good/elbow/actions/rotate") for each in found)
        told = [each for each in found if each["iri"].endswith(f"/{scene.bad}/")]
        assert told and (scene.bad == "huge" or any(PLANTED in str(each.get("fault")) for each in told))
        listed = one.ask("resources/list")["result"]["resources"]
        assert len([each for each in listed if "good" in each["uri"] or scene.bad in each["uri"]]) == 2
        one.end()


def test_health_and_metrics_count_the_robot(scene: Scene) -> None:
    browser = scene.browser
    for path in ("openapi.json", "things"):
        browser.http.get(browser.root + path, headers={"accept": "application/json"})
    ready = browser.http.get(browser.root + "health/ready").json()
    warned = any("1 robots are incomplete" in each for each in ready.get("warnings", ()))
    assert warned == (scene.bad == "broken")
    assert ('linked_fleet_faults{part="OpenAPI"}' in browser.http.get(browser.root + "metrics").text) == warned
    assert scene.bad not in str(ready), "everybody may read it"


def test_queries_see_the_others(scene: Scene) -> None:
    query = "SELECT ?robot { ?robot a <https://w3id.org/linked-fleet#Robot> }"
    fields = {"content-type": "application/sparql-query", "accept": "application/sparql-results+json"}
    answer = scene.browser.http.post(scene.browser.root + "query", content=query, headers=fields)
    assert answer.status_code == 200, answer.text
    rows = {each["robot"]["value"] for each in answer.json()["results"]["bindings"]}
    assert rows == {f"{scene.browser.root}{name}/" for name in ("good", scene.bad)}
