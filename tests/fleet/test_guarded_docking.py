"""A transport base docks at its charging station among crates: the guard checks its way there and back out."""

from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from rdflib import RDF

from browser import LF, Browser
from commanding import ended, problem
from running import eventually
from scene_client import contents, crate, met, put_object, put_robot
from simulated_robots import simulated
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

JSON = {"accept": "application/json"}


class Transport:
    """A client of the simulated base, whose odometry frame is the world."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser
        graph = browser.robot("pmb2").graph
        (self.base,) = map(str, graph.subjects(RDF.type, LF.Base))
        (self.battery,) = map(str, graph.subjects(RDF.type, LF.Battery))
        put_robot(browser, "pmb2", 0, 0, 0)

    def shown(self, of: str) -> dict[str, Any]:
        found: dict[str, Any] = self.browser.http.get(of, headers=JSON).raise_for_status().json()
        return found

    def ask(self, action: str, prefer: str = "", **given: object) -> httpx.Response:
        """Ask once the shapes are prepared."""
        headers = JSON | ({"prefer": prefer} if prefer else {})

        def answered() -> httpx.Response | None:
            answer = self.browser.http.post(f"{self.base}/actions/{action}", json=given, headers=headers)
            return None if answer.status_code == 503 else answer

        return eventually(answered, "an answer that is not 503")

    def do(self, action: str, **given: object) -> None:
        answer = self.ask(action, **given)
        assert answer.status_code == 204, answer.text
        page = ended(self.browser, answer.headers["location"])
        assert page.one(LF.state) == LF.succeeded, page.graph.serialize()

    def go(self, x: float, y: float) -> None:
        self.do("followPath", path=[{"x": x, "y": y, "heading": 0.0}])

    def clear(self) -> None:
        for each in contents(self.browser):
            assert self.browser.http.delete(each).status_code == 204


@pytest.fixture(scope="module")
def transport(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Transport]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), simulated(place.zenoh, "pmb2"):
        live(browser, "pmb2")
        yield Transport(browser)


def test_the_way_to_a_station_is_checked_and_the_one_back_out(transport: Transport) -> None:
    (station,) = transport.shown(transport.base)["stations"]
    assert (station["name"], station["x"], station["y"]) == ("charger", 1.2, 0.0)

    put_object(transport.browser, crate("before it", 0.6, 0, 0.3))
    assert met(transport.ask("dock"))
    transport.clear()
    put_object(transport.browser, crate("in it", 1.5, 0, 0.3))
    assert met(transport.ask("dock", "dry-run"))
    transport.clear()

    put_object(transport.browser, crate("beside it", 0.6, 0.6, 0.3))
    assert transport.ask("dock", "dry-run").json()["collisionFree"] is True
    transport.do("dock")
    eventually(lambda: transport.shown(transport.base)["dockedAt"] == "charger", "docked")
    eventually(lambda: transport.shown(transport.battery)["powerSupplyState"] != "discharging", "charging")

    put_object(transport.browser, crate("behind it", 0.6, 0, 0.3))
    assert met(transport.ask("undock"))
    transport.clear()
    transport.do("undock")
    eventually(lambda: transport.shown(transport.base)["dockedAt"] == "", "undocked")


def test_an_unknown_station_is_refused_with_the_known_ones(transport: Transport) -> None:
    refused = transport.ask("dock", "dry-run", station="west")
    assert refused.status_code == 409, problem(refused)
    assert "this base knows charger" in refused.json()["detail"]


def test_what_is_put_into_the_station_ends_docking_before_it_meets_that(transport: Transport) -> None:
    """Also while the base is still on its way in front of the station, and tells of no more than that."""
    transport.go(0.0, 0.0)
    answer = transport.ask("dock")
    assert answer.status_code == 204, answer.text
    eventually(lambda: transport.shown(transport.base)["pose"]["x"] > 0.2, "a base on its way")
    put_object(transport.browser, crate("in it", 1.5, 0, 0.3))
    page = ended(transport.browser, answer.headers["location"])
    assert page.one(LF.state) == LF.cancelled, page.graph.serialize()
    assert "would meet an obstacle" in str(page.one(LF.reason))
    assert transport.shown(transport.base)["pose"]["x"] == pytest.approx(0.8, abs=0.1)
    assert transport.shown(transport.base)["dockedAt"] == ""
