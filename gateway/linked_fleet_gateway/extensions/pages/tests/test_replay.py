"""Robots as they were: the timeline and the page of a recording show the pose of an instant, and none in a gap."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from urllib.parse import urlencode

import pytest
from playwright.sync_api import Page, ViewportSize, expect
from rdflib import URIRef

from accessibility import violations
from browser import DCTERMS, LDP, LF
from browser import Browser as Client
from chromium import DESK, PHONE
from commanding import of_joint, post, radian
from linked_fleet_gateway.extensions.recordings.resources import TERMS
from running import eventually
from small_fleet import Place, live, offline

pytestmark = [pytest.mark.processes, pytest.mark.test_all, pytest.mark.webgl]
JOINT = "wrist_3_joint"
ONE = re.compile(r"^(1|0\.9\d*|1\.0\d*) rad$")
SHOWN = "() => document.querySelector('#replay .scene').scene"


@dataclass
class Past:
    """A robot that turned its wrist from 0 to 1 rad, was stopped, and left. Times in seconds since 1970.

    Another robot stood beside it, and a crate before the time ``without``.
    """

    root: str
    recording: str
    before: float
    after: float
    without: float
    gone: float

    def timeline(self, at: float) -> str:
        """Return the address of the timeline that begins to show an instant."""
        query = {"from": written(self.before - 20), "until": written(self.gone + 600), "robot": "ur5"}
        return f"{self.root}timeline?{urlencode(query)}#at={written(at)}"


def written(time: float) -> str:
    return datetime.fromtimestamp(time, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


@pytest.fixture(scope="module")
def past(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Past]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, client):
        with place.robot("ur5,twin=ur5"):
            live(client, "ur5")
            live(client, "twin")
            crate = arrange(client)
            arranged, _ = objects(client)
            before = eventually(
                lambda: found if (found := newest(client) or 0) > arranged else None, "a sample since then"
            )
            answer = post(client, of_joint(client, JOINT, LF.Rotate), radian(1.0), prefer="wait=30")
            assert answer.status_code < 300, answer.text
            after = eventually(lambda: found if (found := newest(client)) and found > before + 1 else None, "more")
            client.http.delete(crate).raise_for_status()
            without = eventually(lambda: None if (found := objects(client))[1] else found[0], "no crate on disk")
            post(client, f"{client.root}ur5/actions/stop")
            recording = eventually(lambda: recorded(client), "the recording")
        offline(client, "ur5")
        yield Past(client.root, recording, before, after, without, eventually(lambda: gap(client), "the gap"))


def arrange(client: Client) -> str:
    """Place the robots and a crate, and return the crate once it is on disk."""
    for name, x in (("ur5", 1.0), ("twin", 2.5)):
        answer = client.http.put(f"{client.root}{name}/placement", json={"position": metres(x, 0, 0)})
        assert answer.status_code < 300, answer.text
    thing = {
        "title": "crate",
        "position": metres(1, 2, 0.1),
        "geometry": {"form": LF.Box, "size": metres(0.4, 0.3, 0.2)},
    }
    answer = client.http.post(f"{client.root}world/objects", json=thing)
    assert answer.status_code == 201, answer.text
    eventually(lambda: len(objects(client)[1]) == 1 and robots_placed(client) == 2, "all of it on disk")
    return answer.headers["location"]


def robots_placed(client: Client) -> int:
    page = client.page(f"{client.root}ur5/history/world")
    return len(list(page.graph.objects(page.iri, DCTERMS.hasPart)))


def objects(client: Client) -> tuple[float, list[object]]:
    """Return the objects that are there according to the disk, and since when."""
    page = client.page(f"{client.root}ur5/history/world")
    since = str(page.one(LF["from"]))
    return 0.0 if since == str(LF.unknown) else datetime.fromisoformat(since).timestamp(), list(
        page.graph.objects(page.iri, LDP.contains)
    )


def metres(x: float, y: float, z: float) -> dict[str, object]:
    return {"x": x, "y": y, "z": z, "unit": "http://qudt.org/vocab/unit/M"}


def newest(client: Client) -> float | None:
    text = str(client.page(f"{client.root}ur5/history").one(LF.newestSample))
    return None if text == str(LF.unknown) else datetime.fromisoformat(text).timestamp()


def gap(client: Client) -> float | None:
    """Return the time from which on nothing is known."""
    *_, last = client.http.get(f"{client.root}ur5/history?as=csv&limit=1").text.split()
    time, *values = last.split(",")
    return None if any(values) else datetime.fromisoformat(time).timestamp()


def recorded(client: Client) -> str | None:
    robot = client.robot("ur5")
    for container in robot.graph.objects(robot.iri, URIRef(TERMS + "recordings")):
        return str(next(client.page(str(container)).graph.objects(None, LDP.contains)))
    return None


def opened(page: Page, address: str, size: ViewportSize) -> None:
    page.set_viewport_size(size)
    page.goto(address)
    if size == PHONE:
        page.get_by_role("button", name="Draw it in 3D").click()
    scene = page.locator("#replay .scene")
    scene.scroll_into_view_if_needed()
    expect(scene).to_have_attribute("data-phase", "ready")


def go(page: Page, time: float) -> None:
    page.evaluate("(time) => document.getElementById('replay').replay.go(time)", time)
    expect(page.locator(f"#replay article[data-at='{time}']")).to_have_count(1)


def wrist(page: Page) -> float | None:
    """Return the drawn position; None if the robot is not drawn."""
    found: float | None = page.evaluate(
        f"() => {{ const s = ({SHOWN})(); return s.robot.visible ? s.positions()['{JOINT}'] : null; }}"
    )
    return found


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_a_robot_is_shown_as_it_was_and_not_where_nothing_was_heard(page: Page, past: Past, size: ViewportSize) -> None:
    opened(page, past.timeline(past.after), size)
    assert eventually(lambda: wrist(page), "a pose") == pytest.approx(1.0, abs=0.02)
    expect(page.locator("#replay tbody tr", has_text=JOINT).locator("td").first).to_have_text(ONE)
    assert violations(page) == []
    go(page, past.before)
    assert wrist(page) == pytest.approx(0.0, abs=0.02)
    go(page, past.after - 0.5)
    assert 0.1 < (wrist(page) or 0) <= 1.001
    for nothing in (past.before - 10, past.gone + 0.2):
        go(page, nothing)
        assert wrist(page) is None
        expect(page.locator("#replay .replay-says")).to_contain_text("Nothing is known")
        expect(page.locator("#replay table")).to_be_hidden()
    assert page.evaluate("document.documentElement.scrollWidth") == size["width"]


def test_what_stood_around_a_robot_is_drawn_as_it_was(page: Page, past: Past) -> None:
    opened(page, past.timeline(past.before), DESK)
    around, drawn = page.locator("#replay .replay-around"), f"() => ({SHOWN})().around"
    expect(around).to_have_text("Around it, as they were: twin, crate.")
    standing = (
        f"({drawn})().children.filter((e) => e.visible).flatMap((e) => [e, ...e.children]).map((e) => e.position.x)"
    )
    assert 2.5 in page.evaluate(standing) and 1 in page.evaluate(standing)
    go(page, past.without)
    expect(around).to_have_text("Around it, as they were: twin.")
    assert violations(page) == []
    go(page, past.before - 10)
    expect(around).to_have_text("")
    assert page.evaluate(f"({drawn})().visible") is False


def test_a_recording_plays_to_its_end(page: Page, past: Past) -> None:
    opened(page, past.recording, DESK)
    assert eventually(lambda: page.locator("#replay").get_attribute("data-at"), "its beginning")
    assert wrist(page) == pytest.approx(0.0, abs=0.02)
    assert violations(page) == []
    page.get_by_label("Speed").select_option("4")
    page.get_by_role("button", name="Play").click()
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    eventually(lambda: (wrist(page) or 0) > 0.98, "its end")
    expect(page.get_by_role("button", name="Play")).to_be_visible()
