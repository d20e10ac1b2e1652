"""TIAGo drives among crates, zones and robots: the guard looks ahead along its way and reduces its speed."""

import json
import math
from collections.abc import Iterator

import httpx
import pytest
from rdflib import RDF

from browser import HYBRIT, LF, VOM, Browser, Page
from commanding import TURTLE, ended, problem
from running import eventually
from scene_client import contents, crate, met, placement, put_object, put_robot
from simulated_robots import SimulatedRobot, simulated
from small_fleet import Place, live
from virtual.client import WebSocket
from virtual.loop import current

pytestmark = pytest.mark.virtual

RADIUS_M, CRATE_M = 0.25, 0.3
"""Of the collision geometry of the base, and of a side of a crate."""


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Browser, dict[str, SimulatedRobot]]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), simulated(place.zenoh, "tiago", "pmb2", "ur5") as robots:
        for name in robots:
            live(browser, name)
        yield browser, robots


class Driver:
    """A simulated robot, and a client that drives it. Its odometry frame is where it stands, on empty floor."""

    def __init__(self, browser: Browser, robot: SimulatedRobot, name: str = "tiago") -> None:
        self.browser, self.robot, self.name = browser, robot, name
        (self.url,) = (
            str(url)
            for part in browser.robot(name).graph.subjects(RDF.type, LF.Base)
            for url in browser.page(str(part)).graph.objects(part, HYBRIT.action)
            if LF.Drive in browser.page(str(url)).types
        )
        assert robot.base is not None
        self.base = robot.base

    def begin(self, at_x: float = 0.0, at_y: float = 0.0) -> None:
        """Place the robot so that it stands there in the world, looking along x."""
        x, y, heading = self.base.odometry
        cosine, sine = math.cos(-heading), math.sin(-heading)
        to_x, to_y = at_x - (x * cosine - y * sine), at_y - (x * sine + y * cosine)
        put_robot(self.browser, self.name, to_x, to_y, 0, -heading)
        self.origin = self.base.odometry

    @property
    def at(self) -> tuple[float, float, float]:
        """Where it is from where it began: m, m, rad."""
        now, (x, y, heading) = self.base.odometry, self.origin
        cosine, sine = math.cos(heading), math.sin(heading)
        ahead, left = now.x - x, now.y - y
        turn = math.remainder(now.heading - heading, math.tau)
        return ahead * cosine + left * sine, left * cosine - ahead * sine, turn

    def ask(self, prefer: str = "", **given: float) -> httpx.Response:
        """Ask for a drive once the shapes are prepared."""
        headers = {"prefer": prefer} if prefer else {}

        def answered() -> httpx.Response | None:
            answer = self.browser.http.post(self.url, json=given, headers=headers)
            return None if answer.status_code == 503 else answer

        return eventually(answered, "an answer that is not 503")

    def drive(self, **given: float) -> Page:
        answer = self.ask(**given)
        assert answer.status_code == 204, answer.text
        page = ended(self.browser, answer.headers["location"])
        assert page.one(LF.state) == LF.succeeded, page.graph.serialize()
        return page

    def drive_until_refused(self, **given: float) -> httpx.Response:
        for _ in range(60):
            answer = self.ask(**given)
            if answer.status_code != 204:
                return answer
            ended(self.browser, answer.headers["location"])
        raise AssertionError(f"it was never refused, and is at {self.at}")


@pytest.fixture
def tiago(here: tuple[Browser, dict[str, SimulatedRobot]]) -> Iterator[Driver]:
    browser, robots = here
    for each in contents(browser):
        assert browser.http.delete(each).status_code == 204
    for name in ("ur5", "pmb2"):
        assert browser.http.delete(placement(browser, name)).status_code == 204
    driver = Driver(browser, robots["tiago"])
    driver.begin()
    yield driver


def share_of(page: Page) -> float:
    scale = page.graph.value(page.iri, LF.speedScale)
    return 1.0 if scale is None else float(str(page.graph.value(scale, VOM.numericalValue)))


def test_on_empty_floor_it_drives_as_asked(tiago: Driver) -> None:
    page = tiago.drive(linear=0.8, duration=0.8)
    assert share_of(page) == 1.0
    assert list(page.graph.objects(page.iri, LF.limitedBecause)) == []
    assert tiago.at[0] == pytest.approx(0.64, abs=0.03)


def test_before_a_crate_it_is_slower_and_says_why(tiago: Driver) -> None:
    put_object(tiago.browser, crate("crate", 1.0, 0, 0.3))
    page = tiago.drive(linear=1.0, duration=1.0)
    gap_m = 1.0 - CRATE_M / 2 - RADIUS_M - tiago.at[0]
    assert 0.01 <= gap_m < 0.35
    assert 0.3 < share_of(page) < 0.8
    assert "would meet an obstacle" in str(page.one(LF.limitedBecause))


def test_a_rehearsal_says_how_fast_it_would_be_and_moves_nothing(tiago: Driver) -> None:
    put_object(tiago.browser, crate("crate", 1.0, 0, 0.3))
    answer = tiago.ask("dry-run", linear=1.0, duration=1.0)
    assert answer.status_code == 200
    said = tiago.browser.http.post(
        tiago.url, json={"linear": 1.0, "duration": 1.0}, headers={"prefer": "dry-run", "accept": "application/json"}
    ).json()
    assert 0.3 < said["speedScale"]["value"] < 0.8
    assert "would meet an obstacle" in said["limitedBecause"]
    assert tiago.at == pytest.approx((0, 0, 0), abs=1e-3)


def test_it_comes_near_and_not_nearer(tiago: Driver) -> None:
    put_object(tiago.browser, crate("crate", 1.2, 0, 0.3))
    answer = tiago.drive_until_refused(linear=0.6, duration=0.5)
    assert met(answer)
    gap_m = 1.2 - CRATE_M / 2 - RADIUS_M - tiago.at[0]
    assert 0.009 <= gap_m < 0.06, "the margin is a centimetre"
    tiago.drive(linear=-0.4, duration=0.5)
    assert share_of(tiago.drive(angular=0.5, duration=0.3)) == 1.0


def test_a_zone_is_kept_out_of(tiago: Driver) -> None:
    put_object(tiago.browser, crate("zone", 0.9, 0, 0.3, kind="lf:KeepOutZone"))
    answer = tiago.drive_until_refused(linear=0.6)
    assert problem(answer) == (409, "collision")
    assert "keep-out" in answer.json()["detail"]
    assert tiago.at[0] < 0.9 - CRATE_M / 2 - RADIUS_M


def test_an_arc_meets_what_is_beside_the_straight_way(tiago: Driver) -> None:
    put_object(tiago.browser, crate("crate", 0.8, 0.8, 0.3))
    assert share_of(tiago.drive(linear=0.5, duration=0.2)) == 1.0, "straight on"
    answer = tiago.drive_until_refused(linear=0.5, angular=0.7)
    assert met(answer)


def test_another_robot_is_in_the_way(tiago: Driver) -> None:
    put_robot(tiago.browser, "ur5", 1.2, 0.0, 0.0)
    answer = tiago.drive_until_refused(linear=0.6)
    assert any("/ur5/" in each for each in met(answer))
    assert tiago.at[0] < 1.1


def test_an_arm_is_not_moved_into_the_way_of_a_base_that_drives(tiago: Driver) -> None:
    """UR5 stands beside the way; its arm would reach over it where TIAGo is in a moment."""
    put_robot(tiago.browser, "ur5", 1.3, 0.62, 0.0)
    joint = tiago.browser.part("ur5", "shoulder_lift_joint")
    url = tiago.browser.action(joint, LF.Rotate)
    body = "@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .\n"
    body += "[] vom:numericalValue 0 ; vom:unit unit:DEG ."
    pan = tiago.browser.action(tiago.browser.part("ur5", "shoulder_pan_joint"), LF.Rotate)
    aside = body.replace(" 0 ;", " -90 ;")
    turned = tiago.browser.http.post(pan, content=aside, headers=TURTLE | {"prefer": "wait=30"})
    assert turned.status_code in (200, 201, 204), turned.text
    free = tiago.browser.http.post(url, content=body, headers=TURTLE | {"prefer": "dry-run"})
    assert free.status_code == 200, free.text
    begun = tiago.ask(linear=1.0, duration=1.0)
    assert begun.status_code == 204, begun.text
    refused = tiago.browser.http.post(url, content=body, headers=TURTLE | {"prefer": "dry-run"})
    ended(tiago.browser, begun.headers["location"])
    assert problem(refused) == (409, "collision"), refused.text


def test_a_stream_is_slower_before_a_crate_and_says_why(tiago: Driver) -> None:
    """The stick is pushed forward all the time."""
    put_object(tiago.browser, crate("crate", 1.3, 0, 0.3))
    tiago.ask("dry-run", linear=0.1)  # the shapes are prepared
    loop = current()
    assert loop is not None
    socket = WebSocket(loop, tiago.url.replace("http", "ws", 1), {}, "lf.drive")
    told, shares, end_s = {}, set[float](), loop.time() + 20.0
    while told.get("speedScale") != 0 and loop.time() < end_s:
        told = json.loads(socket.recv(5))
        assert "ended" not in told, json.dumps(told)
        shares.add(told["speedScale"])
        socket.send(json.dumps({"seen": told["time"], "input": {"linear": 0.8, "angular": 0.0}}))
    gap_m = 1.3 - CRATE_M / 2 - RADIUS_M - tiago.at[0]
    assert 0.009 <= gap_m < 0.1
    assert told["speedScale"] == 0
    assert "would meet an obstacle" in told["limitedBecause"]
    assert len(shares) > 5, "it becomes slower bit by bit"
    socket.close()
    eventually(lambda: tiago.base.velocity.linear == pytest.approx(0.0, abs=1e-3), "a standstill")


def path_of(tiago: Driver, *points: tuple[float, float]) -> dict[str, list[dict[str, float]]]:
    """Return the body of a path for points as the robot sees them from where it began."""
    x, y, heading = tiago.origin
    cosine, sine = math.cos(heading), math.sin(heading)
    return {"path": [{"x": x + a * cosine - b * sine, "y": y + a * sine + b * cosine} for a, b in points]}


def test_what_is_put_into_the_way_of_a_path_ends_it(tiago: Driver) -> None:
    """The base stands before it, and the invocation says why."""
    tiago.ask("dry-run", linear=0.1)  # the shapes are prepared
    url = tiago.url.replace("/drive", "/followPath")
    begun = tiago.browser.http.post(url, json=path_of(tiago, (3.0, 0.0)))
    assert begun.status_code == 204, begun.text
    eventually(lambda: tiago.at[0] > 0.4, "a robot on its way")
    put_object(tiago.browser, crate("crate", 2.2, 0, 0.3))
    page = ended(tiago.browser, begun.headers["location"])
    assert page.one(LF.state) == LF.cancelled, page.graph.serialize()
    assert "would meet an obstacle" in str(page.one(LF.reason))
    eventually(lambda: tiago.base.velocity.linear == pytest.approx(0.0, abs=1e-3), "a standstill")
    assert 0.4 < tiago.at[0] < 2.2 - CRATE_M / 2 - RADIUS_M


def test_a_path_across_that_of_another_robot_is_refused(
    tiago: Driver, here: tuple[Browser, dict[str, SimulatedRobot]]
) -> None:
    """Also where the other one is not yet, but will come."""
    pmb2 = Driver(here[0], here[1]["pmb2"], "pmb2")
    pmb2.begin(-1.0, 0.9)
    tiago.ask("dry-run", linear=0.1)  # the shapes are prepared
    along = tiago.browser.http.post(pmb2.url.replace("/drive", "/followPath"), json=path_of(pmb2, (4.0, 0.0)))
    assert along.status_code == 204, along.text
    across = tiago.browser.http.post(
        tiago.url.replace("/drive", "/followPath"), json=path_of(tiago, (1.5, 0.0), (1.5, 1.5))
    )
    assert met(across), across.text
    assert "pmb2" in across.text
    ended(tiago.browser, along.headers["location"])


def test_a_path_through_a_crate_is_refused_and_one_around_it_is_followed(tiago: Driver) -> None:
    put_object(tiago.browser, crate("crate", 1.2, 0, 0.3))
    url = tiago.url.replace("/drive", "/followPath")
    tiago.ask("dry-run", linear=0.1)  # the shapes are prepared
    refused = tiago.browser.http.post(url, json=path_of(tiago, (2.4, 0.0)))
    assert met(refused)
    answer = tiago.browser.http.post(url, json=path_of(tiago, (0.5, 0.9), (1.9, 0.9), (2.4, 0.0)))
    assert answer.status_code == 204, answer.text
    page = ended(tiago.browser, answer.headers["location"])
    assert page.one(LF.state) == LF.succeeded, page.graph.serialize()
    assert tiago.at[:2] == pytest.approx((2.4, 0.0), abs=0.03)
