"""The container of docs/EXTENDING.md, installed outside of the repository, at two gateways that share it."""

import json
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pyshacl
import pytest
import rdflib
from rdflib import RDF, URIRef

from browser import HYBRIT, LF, Browser
from extending_page import installed_example
from gateway_group import Gateway, gateways, hub
from redis_servers import single
from running import eventually

pytestmark = pytest.mark.virtual
MY = rdflib.Namespace("https://example.org/stations#")


@dataclass(frozen=True)
class Here:
    """Two gateways with the extension."""

    one: Gateway
    other: Gateway

    def add(self, title: str = "Dock", bays: int = 1) -> str:
        """Add a station at one gateway, wait until the other one knows it, and return its path."""
        answer = self.one.browser.http.post(self.one.browser.root + "stations", json={"title": title, "bays": bays})
        assert answer.status_code == 201, answer.text
        path = httpx.URL(answer.headers["location"]).path
        eventually(lambda: self.get(self.other, path).status_code == 200, "the station at the other gateway")
        return path

    def get(self, gateway: Gateway, path: str, accept: str = "text/turtle") -> httpx.Response:
        return gateway.browser.http.get(gateway.browser.root + path[1:], headers={"accept": accept})

    def reserve(self, gateway: Gateway, path: str, seconds: float, **fields: str) -> httpx.Response:
        url = f"{gateway.browser.root}{path[1:]}/actions/reserve"
        return gateway.browser.http.post(url, json={"seconds": seconds}, headers=fields)

    def free(self, gateway: Gateway, path: str) -> int:
        page = gateway.browser.page(gateway.browser.root + path[1:])
        return int(str(page.one(MY.free)))

    def state(self, gateway: Gateway, location: str) -> str:
        page = gateway.browser.page(gateway.here(location))
        return str(page.one(LF.state)).rpartition("#")[2]


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Here]:
    with (
        installed_example("stations", tmp_path) as name,
        single(tmp_path / "redis") as server,
        hub() as fleet,
        gateways(fleet, server.url, flags=("--extensions", name)) as (one, other),
    ):
        yield Here(one, other)


def test_stations_are_added_read_replaced_patched_and_deleted_at_any_gateway(here: Here) -> None:
    path = here.add("Dock", 2)
    assert here.free(here.other, path) == 2
    url = here.other.browser.root + path[1:]
    http = here.other.browser.http
    etag = http.get(url).headers["etag"]
    body = f'<> <http://purl.org/dc/terms/title> "Bay" ; <{MY.bays}> 3 .'
    turtle = {"content-type": "text/turtle"}
    assert http.put(url, content=body, headers=turtle | {"if-match": '"other"'}).status_code == 412
    assert http.put(url, content=body, headers=turtle | {"if-match": etag}).status_code == 204
    eventually(lambda: here.free(here.one, path) == 3, "the change at the first gateway")
    update = f"DELETE {{ <> <{MY.bays}> 3 }} INSERT {{ <> <{MY.bays}> 4 }} WHERE {{}}"
    patched = http.patch(url, content=update, headers={"content-type": "application/sparql-update"})
    assert patched.status_code == 204, patched.text
    eventually(lambda: here.free(here.one, path) == 4, "the patch at the first gateway")
    assert here.one.browser.http.delete(here.one.browser.root + path[1:]).status_code == 204
    eventually(lambda: here.get(here.other, path).status_code == 404, "the end of the station")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('<> <http://purl.org/dc/terms/title> "Dock" .', "bays"),
        (f'<> <http://purl.org/dc/terms/title> "Dock" ; <{MY.bays}> 0 .', "bays"),
        (f'<> <http://purl.org/dc/terms/title> "Dock" ; <{MY.bays}> 1 ; <{MY.free}> 1 .', "free"),
        (f'<> <http://purl.org/dc/terms/title> "Dock", "Bay" ; <{MY.bays}> 1 .', "title"),
        ("", "empty"),
    ],
)
def test_a_body_that_breaks_the_shape_is_refused_with_the_reason(here: Here, body: str, words: str) -> None:
    answer = here.one.browser.http.post(
        here.one.browser.root + "stations", content=body, headers={"content-type": "text/turtle"}
    )
    assert answer.status_code == 422, answer.text
    assert words in answer.text


def test_descriptions_conform_to_their_blueprints_and_link_their_actions(here: Here) -> None:
    path = here.add()
    root = here.one.browser.page(here.one.browser.root)
    assert root.one(MY.stations) == URIRef(here.one.browser.root + "stations")
    for each in ("/stations", path):
        page = here.one.browser.page(here.one.browser.root + each[1:])
        shapes = here.one.browser.page(f"{here.one.browser.root}{each[1:]}/blueprint")
        conforms, _, report = pyshacl.validate(page.graph, shacl_graph=shapes.graph)
        assert conforms, report
    station = here.one.browser.page(here.one.browser.root + path[1:])
    assert (station.iri, RDF.type, MY.Station) in station.graph
    assert station.one(HYBRIT.action) == URIRef(f"{station.iri}/actions/reserve")


def test_a_reservation_is_an_invocation_that_both_gateways_show_and_that_ends(here: Here) -> None:
    path = here.add()
    answer = here.reserve(here.one, path, 60)
    assert answer.status_code == 204, answer.text
    location = answer.headers["location"]
    assert here.state(here.one, location) == "running"
    eventually(lambda: here.free(here.other, path) == 0, "the reservation at the other gateway")
    time.sleep(40)  # longer than a gateway may be silent
    assert [here.state(each, location) for each in (here.one, here.other)] == ["running", "running"]
    refused = here.reserve(here.other, path, 60)
    assert refused.status_code == 409 and "All 1 bays" in refused.text
    eventually(lambda: here.state(here.other, location) == "succeeded", "the end of the reservation")
    assert here.free(here.one, path) == 1
    assert here.reserve(here.other, path, 60).status_code == 204


def test_a_reservation_is_rehearsed_repeated_and_cancelled_at_the_other_gateway(here: Here) -> None:
    path = here.add(bays=2)
    rehearsal = here.reserve(here.one, path, 60, prefer="dry-run", accept="application/json")
    assert rehearsal.status_code == 200 and json.loads(rehearsal.text)["duration"]["value"] == 60
    assert here.free(here.one, path) == 2
    first = here.reserve(here.one, path, 60, **{"idempotency-key": '"once"'})
    again = here.reserve(here.one, path, 60, **{"idempotency-key": '"once"'})
    assert first.headers["location"] == again.headers["location"] and here.free(here.one, path) == 1
    other = here.reserve(here.one, path, 61, **{"idempotency-key": '"once"'})
    assert other.status_code == 422, other.text
    location = first.headers["location"]
    eventually(lambda: here.get(here.other, httpx.URL(location).path).status_code == 200, "the invocation")
    cancelled = here.other.browser.http.post(here.other.here(location) + "/actions/cancel")
    assert cancelled.status_code == 204, cancelled.text
    assert here.state(here.other, location) == "cancelled"
    eventually(lambda: here.free(here.one, path) == 2, "the free bay")


@pytest.mark.parametrize("method", ["PUT", "PATCH"])
def test_a_reservation_is_kept_when_its_station_is_written(here: Here, method: str) -> None:
    path = here.add("Dock", 2)
    assert here.reserve(here.one, path, 60).status_code == 204
    url = here.one.browser.root + path[1:]
    if method == "PUT":
        written = here.one.browser.http.put(url, json=here.get(here.one, path, "application/json").json() | {"bays": 1})
    else:
        update = f"DELETE {{ <> <{MY.bays}> 2 }} INSERT {{ <> <{MY.bays}> 1 }} WHERE {{}}"
        media_type = {"content-type": "application/sparql-update"}
        written = here.one.browser.http.patch(url, content=update, headers=media_type)
    assert written.status_code == 204, written.text
    assert here.free(here.one, path) == 0
    refused = here.reserve(here.one, path, 60)
    assert refused.status_code == 409 and "All 1 bays" in refused.text


def test_a_bay_is_free_when_the_invocation_that_held_it_is_deleted(here: Here) -> None:
    path = here.add()
    location = here.reserve(here.other, path, 3600).headers["location"]
    here.other.process.send(signal.SIGKILL)
    eventually(lambda: here.state(here.one, location) == "failed", "the end of the reservation")
    assert here.one.browser.http.delete(here.one.here(location)).status_code == 204
    assert here.reserve(here.one, path, 1).status_code == 204


def test_a_reservation_of_a_gateway_that_dies_is_ended_by_the_other(here: Here) -> None:
    path = here.add()
    location = here.reserve(here.one, path, 3600).headers["location"]
    eventually(lambda: here.free(here.other, path) == 0, "the reservation")
    here.one.process.send(signal.SIGKILL)
    eventually(lambda: here.state(here.other, location) == "failed", "the end of the reservation")
    assert here.free(here.other, path) == 1
    assert here.reserve(here.other, path, 1).status_code == 204


def test_delete_of_a_station_ends_its_reservations(here: Here) -> None:
    path = here.add()
    location = here.reserve(here.one, path, 600).headers["location"]
    eventually(lambda: here.free(here.other, path) == 0, "the reservation at the other gateway")
    assert here.other.browser.http.delete(here.other.browser.root + path[1:]).status_code == 204
    eventually(lambda: here.get(here.one, path).status_code == 404, "the end of the station")
    root = here.one.browser.http.get(here.one.browser.root, headers={"accept": "text/turtle"}).text
    assert location not in root


def test_both_gateways_show_stations_in_the_same_order(here: Here) -> None:
    paths = [here.add(f"Dock {number}") for number in range(8)]
    answers = [each.browser.http.get(each.browser.root + "stations") for each in (here.one, here.other)]
    ids = [path.rpartition("/")[2] for path in paths]
    orders = [sorted(ids, key=answer.text.index) for answer in answers]
    assert orders[0] == orders[1]
    member = here.get(here.one, paths[0], "application/json")
    assert member.status_code == 200 and member.json() == {"title": "Dock 0", "bays": 1}


def test_the_first_report_is_known_to_other_gateways_at_once(here: Here) -> None:
    path = here.add()
    location = here.reserve(here.one, path, 60).headers["location"]
    url = httpx.URL(location).path
    eventually(lambda: here.get(here.other, url).status_code == 200, "the invocation")
    time.sleep(1)
    assert here.state(here.other, location) == "running"


def test_the_page_the_navigation_the_metric_and_the_operations_are_there(here: Here) -> None:
    path = here.add("Dock <1>")
    page = here.get(here.one, "/stations", "text/html").text
    assert "Free bays" in page and "Dock &lt;1&gt;" in page and "</a>: 1</li>" in page
    assert ">Stations</a>" in page
    assert "linked_fleet_stations 1.0" in here.get(here.one, "/metrics", "text/plain").text
    paths = json.loads(here.get(here.one, "/openapi.json", "application/json").text)["paths"]
    assert {"post", "get"} <= paths["/stations"].keys()
    assert {"get", "put", "patch", "delete"} <= paths["/stations/{id}"].keys()
    assert "post" in paths["/stations/{id}/actions/reserve"]
    assert path


def test_subscribers_of_a_station_hear_of_reservations_at_the_other_gateway(here: Here) -> None:
    path = here.add()
    browser: Browser = here.other.browser
    with browser.http.stream("GET", browser.root + path[1:], headers={"accept": "text/event-stream"}) as stream:
        lines = stream.iter_lines()
        assert here.reserve(here.one, path, 60).status_code == 204
        assert any("free> 0" in line or "free 0" in line for line in lines)


def test_a_client_of_plain_json_gets_the_member_that_it_adds(here: Here) -> None:
    root = here.one.browser.root
    fields = {"accept": "application/json"}
    answer = here.one.browser.http.post(root + "stations", json={"title": "Dock", "bays": 3}, headers=fields)
    assert (answer.status_code, answer.headers["content-type"]) == (201, "application/json")
    assert answer.json()["bays"] == 3
    refused = here.one.browser.http.post(root + "stations", json={}, headers={"accept": "image/png"})
    assert refused.status_code == 406


def test_a_container_has_actions_of_its_own(here: Here) -> None:
    """``lf:offeredBy`` names the class of the container: the stop of the example ends all reservations."""
    path = here.add(bays=2)
    held = [here.reserve(each, path, 600).headers["location"] for each in (here.one, here.other)]
    container = here.one.browser.page(here.one.browser.root + "stations")
    action = f"{here.one.browser.root}stations/actions/clear"
    assert container.one(HYBRIT.action) == URIRef(action)
    released = here.one.browser.http.post(action)
    assert released.status_code == 204, released.text
    for location in held:
        eventually(lambda location=location: here.state(here.one, location) == "cancelled", "the end of a reservation")  # type: ignore[misc]
    paths = json.loads(here.get(here.one, "/openapi.json", "application/json").text)["paths"]
    assert "post" in paths["/stations/actions/clear"]
