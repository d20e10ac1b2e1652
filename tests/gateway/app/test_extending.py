"""The odometer of docs/EXTENDING.md, installed outside of the repository."""

from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from rdflib import URIRef

from browser import HYBRIT, VOM, Browser, Page
from extending_page import installed_example
from fake_robots import FakeRobot, open_session
from running import eventually, process
from small_fleet import Place
from subscribers import events

pytestmark = pytest.mark.virtual

_ODOMETER = "https://example.org/odometer#"


def _turned(page: Page) -> float:
    scalar = page.graph.value(page.iri, URIRef(_ODOMETER + "turned"))
    return float(str(page.graph.value(scalar, VOM.numericalValue)))


@dataclass(frozen=True)
class Here:
    browser: Browser
    actor: FakeRobot
    url: str

    def turned(self) -> float:
        return _turned(self.browser.page(self.url))

    def turn(self, angle: float) -> None:
        """Move until the gateway has seen the joint there."""
        rotation = self.url.replace("odometer", "elbow/rotation")

        def seen() -> bool:
            self.actor.put("state", self.actor.frame((angle,)))
            return f'"{angle!r}"' in self.browser.http.get(rotation, headers={"accept": "text/turtle"}).text

        eventually(seen, f"the elbow at {angle}")


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Here]:
    folder = tmp_path_factory.mktemp("odometer")
    place = Place(folder / "state")
    with (
        installed_example("odometer", folder) as name,
        process(*place.command(), "--extensions", name) as gateway,
        open_session(place.zenoh) as session,
    ):
        gateway.said("serving")
        browser = Browser(place.root)
        found = Here(browser, FakeRobot(session, "odd").appear(), f"{place.root}odd/odometer")
        eventually(lambda: browser.http.get(found.url).status_code == 200, "the robot")
        found.turn(0.0)
        yield found
        browser.close()


def test_the_resource_of_the_extension_is_linked_and_served_in_all_types(here: Here) -> None:
    robot = here.browser.page(here.url.removesuffix("odometer"))
    assert (robot.iri, URIRef(_ODOMETER + "odometer"), URIRef(here.url)) in robot.graph
    assert (robot.iri, HYBRIT.property, URIRef(here.url)) not in robot.graph
    for media_type in ("text/turtle", "application/ld+json", "text/html"):
        answer = here.browser.http.get(here.url, headers={"accept": media_type})
        assert answer.headers["content-type"].startswith(media_type)


def test_the_extension_counts_and_can_be_reset(here: Here) -> None:
    assert here.browser.http.post(here.url).status_code == 204
    for angle in (0.5, 0.25, 0.0):
        here.turn(angle)
    assert here.turned() == 1.0
    etag = here.browser.http.get(here.url).headers["etag"]
    assert here.browser.http.get(here.url, headers={"if-none-match": etag}).status_code == 304
    assert here.browser.http.post(here.url).status_code == 204
    assert here.turned() == 0.0
    assert here.browser.http.get(here.url, headers={"if-none-match": etag}).status_code == 200
    assert here.browser.http.put(here.url).status_code == 405


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ({"prefer": "dry-run"}, 400),
        ({"prefer": "wait=1;x=y, Dry-Run=1"}, 400),
        ({"prefer": "handling=strict, return=representation"}, 400),
        ({"prefer": "handling=strict, unheard-of"}, 400),
        ({"idempotency-key": '"once"'}, 400),
        ({"lock-token": "<urn:uuid:12345678-1234-1234-1234-123456789abc>"}, 400),
        ({"if-match": '"other"'}, 412),
        ({"if-none-match": "*"}, 412),
        ({"if-unmodified-since": "Sat, 29 Oct 1994 19:43:31 GMT"}, 412),
        ({"if": "(<urn:uuid:12345678-1234-1234-1234-123456789abc>)"}, 412),
    ],
)
def test_the_core_refuses_what_the_extension_does_not_honour(here: Here, fields: dict[str, str], status: int) -> None:
    here.turn(0.0)
    assert here.browser.http.post(here.url).status_code == 204
    here.turn(0.25)
    here.turn(0.0)
    answer = here.browser.http.post(here.url, headers=fields)
    assert answer.status_code == status, answer.text
    assert here.turned() == 0.5


@pytest.mark.parametrize("prefer", ["return=minimal", "wait=1", "handling=lenient, unheard-of", "handling=strict"])
def test_preferences_that_exclude_nothing_are_taken(here: Here, prefer: str) -> None:
    assert here.browser.http.post(here.url, headers={"prefer": prefer}).status_code == 204


def test_subscribers_hear_what_the_extension_tells_the_fan_out(here: Here) -> None:
    with events(here.url, "text/event-stream") as stream:
        assert here.browser.http.post(here.url).status_code == 204
        eventually(lambda: _turned(stream.next()) == 0.0, "the reset")
        here.turn(0.5)
        eventually(lambda: _turned(stream.next()) == 0.5, "half a radian")
        here.turn(0.0)


def test_the_metric_of_the_extension_is_exported(here: Here) -> None:
    numbers = here.browser.http.get(here.url.replace("odd/odometer", "metrics")).text
    assert 'linked_fleet_odometer{robot="odd"}' in numbers
