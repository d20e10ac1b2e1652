"""Two gateways in one process and one event loop, with different extensions."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

from browser import ROS, Browser
from extending_page import installed_example
from fake_robots import FakeRobot, open_session
from redis_servers import single
from running import eventually, free_port, process
from subscribers import events

pytestmark = pytest.mark.virtual


@dataclass(frozen=True)
class Here:
    """A gateway with the docking stations and without the world, one the other way round, and a robot ``stations``."""

    with_stations: Browser
    with_world: Browser
    robot: FakeRobot

    def robot_url(self, browser: Browser) -> str:
        return browser.root + ("~73tations/" if browser is self.with_stations else "stations/")


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Here]:
    zenoh, ports = f"tcp/127.0.0.1:{free_port()}", (free_port(), free_port())
    with (
        installed_example("stations", tmp_path) as name,
        single(tmp_path / "redis") as server,
        open_session(zenoh) as session,
    ):
        shared = ("--zenoh-connect", zenoh, "--redis-url", server.url)
        first = ("-m", "linked_fleet_gateway", "--port", str(ports[0]), *shared)
        other = ("-m", "linked_fleet_gateway", "--port", str(ports[1]), *shared)
        with (
            process(*first, "--extensions", name, "--extensions-off", "world,foxglove,navigation,planning") as one,
            process(*other) as two,
        ):
            one.said("serving")
            two.said("serving")
            browsers = [Browser(f"http://127.0.0.1:{port}/") for port in ports]
            found = Here(browsers[0], browsers[1], FakeRobot(session, "stations").appear())
            for browser in browsers:
                eventually(lambda: browser.http.get(found.robot_url(browser)).status_code == 200, "the robot")  # noqa: B023
            yield found
            for browser in browsers:
                browser.close()


def status(browser: Browser, path: str) -> int:
    return browser.http.get(browser.root + path).status_code


def test_each_has_the_resources_terms_and_pages_of_its_own_extensions(here: Here) -> None:
    for _ in range(2):  # what one has cached is not shown by the other
        assert status(here.with_stations, "stations") == 200 and status(here.with_stations, "world") == 404
        assert status(here.with_world, "world") == 200
        assert status(here.with_world, "stations") == 308  # to the robot
        vocabularies = [each.http.get(each.root + "vocabulary").text for each in (here.with_stations, here.with_world)]
        assert ["KeepOutZone" in each for each in vocabularies] == [False, True]
        pages = [
            each.http.get(each.root, headers={"accept": "text/html"}).text
            for each in (here.with_stations, here.with_world)
        ]
        assert [">Stations</a>" in each for each in pages] == [True, False]
        assert [">World</a>" in each for each in pages] == [False, True]


def test_a_robot_is_escaped_where_an_extension_has_its_name(here: Here) -> None:
    for browser in (here.with_stations, here.with_world):
        page = browser.page(here.robot_url(browser))
        assert str(page.iri) == here.robot_url(browser)
        joint = browser.part("stations", "elbow")
        assert joint.url.startswith(here.robot_url(browser))


def test_messages_name_the_robot_as_their_gateway_does(here: Here) -> None:
    """They are written after frames, which a thread of Zenoh hands over."""
    for angle, browser in enumerate((here.with_stations, here.with_world), start=1):
        rotation = str(browser.part("stations", "elbow").one(ROS.rotation))
        assert rotation.startswith(here.robot_url(browser))
        with events(rotation, "text/event-stream") as stream:
            here.robot.put("state", here.robot.frame((angle / 8,)))
            said = stream.next()
            while said.angle != angle / 8:
                said = stream.next()
            assert str(said.iri) == rotation


def test_properties_and_settings_of_extensions_are_those_of_their_gateway(here: Here) -> None:
    placed = f"{here.robot_url(here.with_world)}placement"
    assert here.with_world.http.get(placed).status_code == 200
    assert here.with_stations.http.get(f"{here.robot_url(here.with_stations)}placement").status_code == 404
    queried = [
        httpx.post(
            f"{each.root}query",
            content="SELECT ?r { ?r a <https://w3id.org/linked-fleet#Robot> }",
            headers={"content-type": "application/sparql-query", "accept": "text/csv"},
        )
        for each in (here.with_stations, here.with_world)
    ]
    assert [answer.text.split() for answer in queried] == [
        ["r", here.robot_url(here.with_stations)],
        ["r", here.robot_url(here.with_world)],
    ]
