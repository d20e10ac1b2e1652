"""Clients that use only plain JSON command a robot: rehearse, move, take control."""

from collections.abc import Iterator

import httpx
import pytest

from running import PATIENCE_S, eventually
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"
ROTATE = "/ur5/elbow_joint/actions/rotate"


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), place.ur5(), httpx.Client(base_url=place.root, timeout=PATIENCE_S) as http:
        live(browser, "ur5")
        yield http


def _ask(http: httpx.Client, prefer: str, query: str = "?as=json", accept: str = "*/*") -> httpx.Response:
    body = {"value": 1.5, "unit": RAD, "speedScale": 0.05}
    return http.post(ROTATE + query, json=body, headers={"prefer": prefer, "accept": accept})


def test_the_invocation_is_answered_in_the_format_that_the_address_picks(http: httpx.Client) -> None:
    """``as`` selects it, as for any resource: generated clients and links do not set Accept."""
    begun = _ask(http, "return=representation")
    assert (begun.status_code, begun.headers["content-type"]) == (201, "application/json")
    path = f"{ROTATE}/invocations/{begun.json()['id']}"
    assert begun.headers["location"].endswith(path)
    assert http.post(path + "/actions/cancel").status_code == 204
    eventually(lambda: http.get(path + "?as=json").json()["state"].endswith("cancelled"), "its end")


def test_a_word_that_picks_no_format_moves_nothing(http: httpx.Client) -> None:
    before = http.get(f"{ROTATE}/invocations?as=jsonld").json()
    for prefer in ("return=representation", "return=minimal", "dry-run"):
        refused = _ask(http, prefer, "?as=nothing")
        assert refused.status_code == 406 and "json" in refused.json()["offered"]
    assert http.get(f"{ROTATE}/invocations?as=jsonld").json() == before


@pytest.mark.parametrize(("query", "accept"), [("?as=json", "*/*"), ("", "application/json")])
def test_a_rehearsal_is_had_in_plain_json(http: httpx.Client, query: str, accept: str) -> None:
    """With the same members as in RDF: duration, end, and that the path was found free of collisions."""
    rehearsed = _ask(http, "dry-run", query, accept)
    assert (rehearsed.status_code, rehearsed.headers["content-type"]) == (200, "application/json")
    said = rehearsed.json()
    assert said["duration"]["value"] > 0 and said["collisionFree"] in (True, None)
    (target,) = said["target"]
    assert target["joint"].endswith("/ur5/elbow_joint") and target["value"] == 1.5
    halted = http.post("/ur5/actions/stop?as=json", headers={"prefer": "dry-run"})
    assert halted.status_code == 200 and "collisionFree" not in halted.json()


def test_control_is_taken_and_released_in_plain_json(http: httpx.Client) -> None:
    taken = http.put("/ur5/lease", json={"holder": "a planner", "duration": 30})
    assert taken.status_code == 204
    refused = _ask(http, "return=minimal")
    assert refused.status_code == 409 and refused.json()["holder"] == "a planner"
    assert http.put("/ur5/lease", json={"holder": "", "duration": 30}).status_code == 422
    assert http.put("/ur5/lease", json={"holder": "x", "seconds": 30}).status_code == 422
    assert http.delete("/ur5/lease", headers={"lock-token": taken.headers["lock-token"]}).status_code == 204


@pytest.mark.parametrize("token", ["", "<urn:uuid:", "<urn:uuid:00000000-0000-4000-8000-000000000000", "a, b"])
def test_a_token_that_is_none_is_refused_and_not_left_out(http: httpx.Client, token: str) -> None:
    """A client that lost its token, or a part of it, is refused before the robot is asked."""
    body = {"value": 1.5, "unit": RAD}
    refused = http.post(ROTATE, json=body, headers={"lock-token": token})
    assert refused.status_code == 400 and "Lock-Token" in refused.json()["detail"]
    assert http.put("/ur5/title", json={"value": "Arm"}, headers={"lock-token": token}).status_code == 400
