"""Simulated bases drive to goals: round crates, anew when one is put into the way, and past each other."""

import math
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from rdflib import RDF

from browser import HYBRIT, LF, VOM, Browser, Page
from commanding import control, ended, problem, put
from running import eventually
from scene_client import contents, crate, placement, put_object, put_robot
from simulated_robots import SimulatedRobot, simulated
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

UNIT = "http://qudt.org/vocab/unit/"
JSON = {"accept": "application/json"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    return Place(tmp_path_factory.mktemp("state"))


@pytest.fixture(scope="module")
def here(place: Place) -> Iterator[tuple[Browser, dict[str, SimulatedRobot]]]:
    with place.gateway() as (_, browser), simulated(place.zenoh, "tiago", "pmb2") as robots:
        for name in robots:
            live(browser, name)
        yield browser, robots


class Driver:
    """A client that sends a simulated robot to goals. Its odometry frame is where it stands."""

    def __init__(self, browser: Browser, robot: SimulatedRobot, name: str, x: float, y: float) -> None:
        self.browser, self.name = browser, name
        self.url = f"{browser.root}{name}/actions/driveTo"
        assert robot.base is not None
        self.base = robot.base
        now = self.base.odometry
        cosine, sine = math.cos(-now.heading), math.sin(-now.heading)
        self.placed = x - (now.x * cosine - now.y * sine), y - (now.x * sine + now.y * cosine), -now.heading
        put_robot(browser, name, *self.placed[:2], 0, self.placed[2])

    @property
    def at(self) -> tuple[float, float, float]:
        """Where it stands in the world: m, m, rad."""
        now, (x, y, heading) = self.base.odometry, self.placed
        cosine, sine = math.cos(heading), math.sin(heading)
        turned = math.remainder(now.heading + heading, math.tau)
        return x + now.x * cosine - now.y * sine, y + now.x * sine + now.y * cosine, turned

    def ask(self, x: float, y: float, degrees: float | None = None, *, prefer: str = "", **more: Any) -> httpx.Response:
        looks = {} if degrees is None else {"heading": {"value": degrees, "unit": UNIT + "DEG"}}
        return self.send({"position": point(x, y)} | looks | more, prefer)

    def near(self, thing: str) -> httpx.Response:
        return self.send({"near": thing}, "", "driveNear")

    def send(self, body: dict[str, Any], prefer: str = "", action: str = "driveTo") -> httpx.Response:
        headers = JSON | ({"prefer": prefer} if prefer else {})

        def answered() -> httpx.Response | None:
            answer = self.browser.http.post(self.url.replace("driveTo", action), json=body, headers=headers, timeout=60)
            return None if answer.status_code == 503 else answer

        return eventually(answered, "an answer that is not 503")

    def begin(self, *given: Any, **more: Any) -> str:
        answer = self.ask(*given, **more)
        assert answer.status_code == 204, answer.text
        return answer.headers["location"]

    def end(self, invocation: str) -> Page:
        page = ended(self.browser, invocation)
        assert page.one(LF.state) == LF.succeeded, page.graph.serialize()
        return page

    def state(self, invocation: str) -> dict[str, Any]:
        found: dict[str, Any] = self.browser.http.get(invocation, headers=JSON).json()
        return found


def point(x: float, y: float) -> dict[str, Any]:
    return {"x": x, "y": y, "unit": UNIT + "M"}


@pytest.fixture
def tiago(here: tuple[Browser, dict[str, SimulatedRobot]]) -> Driver:
    """TIAGo at the origin, alone."""
    browser, robots = here
    for each in contents(browser):
        assert browser.http.delete(each).status_code == 204
    browser.http.delete(placement(browser, "pmb2"))
    return Driver(browser, robots["tiago"], "tiago", 0.0, 0.0)


@pytest.fixture
def pmb2(here: tuple[Browser, dict[str, SimulatedRobot]], tiago: Driver) -> Driver:
    return Driver(here[0], here[1]["pmb2"], "pmb2", 3.0, 0.0)


def test_it_drives_round_a_crate_and_says_how_near_it_came(tiago: Driver) -> None:
    put_object(tiago.browser, crate("crate", 1.5, 0, 0.3))
    page = tiago.end(tiago.begin(3.0, 0.0, 90.0))
    assert tiago.at == pytest.approx((3.0, 0.0, math.pi / 2), abs=0.03)
    (output,) = page.graph.objects(page.iri, LF.output)
    off = page.graph.value(page.graph.value(output, LF.positionError), VOM.numericalValue)
    assert float(str(off)) == pytest.approx(math.dist(tiago.at[:2], (3.0, 0.0)), abs=1e-3)


def test_a_rehearsal_says_how_long_it_takes_and_moves_nothing(tiago: Driver) -> None:
    said = tiago.ask(2.0, 0.0, prefer="dry-run")
    assert said.status_code == 200 and said.json()["duration"]["value"] > 2.0
    assert tiago.at == pytest.approx((0, 0, 0), abs=1e-3)


def test_what_blocks_is_named(tiago: Driver) -> None:
    iri = put_object(tiago.browser, crate("crate", 1.5, 0, 0.3))
    for prefer in ("", "dry-run"):
        answer = tiago.ask(1.5, 0.1, prefer=prefer)
        assert problem(answer) == (409, "unreachable")
        assert answer.json()["blockers"] == [iri] and "crate" in answer.json()["detail"]


def test_it_finds_another_way_when_something_is_put_in_its_way(tiago: Driver) -> None:
    run = tiago.begin(3.5, 0.0)
    eventually(lambda: tiago.at[0] > 0.3, "a robot on its way")
    put_object(tiago.browser, crate("crate", 2.0, 0, 0.3))
    tiago.end(run)
    assert tiago.at[:2] == pytest.approx((3.5, 0.0), abs=0.03)


def test_two_that_meet_pass_each_other(tiago: Driver, pmb2: Driver) -> None:
    """One of them drives to where the other one stands, and waits until it has left."""
    runs = [(tiago, tiago.begin(3.0, 1.2)), (pmb2, pmb2.begin(0.0, 0.0))]
    for driver, run in runs:
        driver.end(run)
    assert tiago.at[:2] == pytest.approx((3.0, 1.2), abs=0.03)
    assert pmb2.at[:2] == pytest.approx((0.0, 0.0), abs=0.03)


def test_two_that_swap_places_by_two_gateways_give_way(
    place: Place, here: tuple[Browser, dict[str, SimulatedRobot]], tiago: Driver
) -> None:
    """Each stands at the goal of the other one, so one of them has to be asked to leave, through its own gateway."""
    with Place(place.state, zenoh=place.zenoh).gateway() as (_, browser):
        for name in ("tiago", "pmb2"):
            live(browser, name)
        pmb2 = Driver(browser, here[1]["pmb2"], "pmb2", 3.0, 0.0)
        eventually(lambda: tiago.ask(1.5, 0.0, prefer="dry-run").status_code == 200, "the placement at both")
        first = tiago.begin(0.6, 0.0)
        eventually(lambda: tiago.at[0] > 0.3, "a robot on its way")
        run = pmb2.begin(0.6, 0.0)
        tiago.end(first)
        tiago.end(tiago.begin(3.0, 0.0))
        pmb2.end(run)
        assert tiago.at[:2] == pytest.approx((3.0, 0.0), abs=0.03)
        assert pmb2.at[:2] == pytest.approx((0.6, 0.0), abs=0.03)


def test_a_robot_that_stands_in_the_way_for_ever_is_named(tiago: Driver, pmb2: Driver) -> None:
    """It is on no drive, so nobody sends it away."""
    answer = tiago.ask(3.0, 0.1)
    assert problem(answer) == (409, "unreachable")
    assert answer.json()["blockers"] == [f"{tiago.browser.root}pmb2/"]


def test_near_a_thing_it_looks_at_it(tiago: Driver) -> None:
    iri = put_object(tiago.browser, crate("crate", 2.5, 1.0, 0.3))
    answer = tiago.near(iri)
    assert answer.status_code == 204, answer.text
    tiago.end(answer.headers["location"])
    x, y, heading = tiago.at
    assert 0.3 < math.dist((x, y), (2.5, 1.0)) < 1.2
    assert heading == pytest.approx(math.atan2(1.0 - y, 2.5 - x), abs=0.05)


def test_a_goal_may_be_given_in_the_frame_of_a_thing(tiago: Driver) -> None:
    iri = put_object(tiago.browser, crate("crate", 2.5, 1.0, 0.3))
    tiago.end(tiago.begin(-1.0, 0.0, 0.0, inFrame=iri, speedScale=0.8))
    assert tiago.at == pytest.approx((1.5, 1.0, 0.0), abs=0.03)


def test_it_does_not_leave_a_corridor(tiago: Driver) -> None:
    strip = {"start": point(-0.5, 0), "end": point(3.5, 0), "width": {"value": 1.4, "unit": UNIT + "M"}}
    tiago.end(tiago.begin(2.0, 0.0, corridor=[strip]))
    put_object(tiago.browser, crate("crate", 1.0, 0, 0.3))
    assert problem(tiago.ask(0.0, 0.0, corridor=[strip])) == (409, "unreachable")
    tiago.end(tiago.begin(0.0, 0.0))


def test_a_newer_drive_takes_over(tiago: Driver) -> None:
    first = tiago.begin(4.0, 0.0)
    eventually(lambda: tiago.at[0] > 0.3, "a robot on its way")
    tiago.end(tiago.begin(1.0, 1.0))
    assert tiago.state(first)["state"].endswith("cancelled")
    assert tiago.state(first)["reason"] == "a newer drive of the base has taken over"
    assert tiago.at[:2] == pytest.approx((1.0, 1.0), abs=0.03)


@pytest.mark.parametrize("by", ["stop", "cancel", "stick"])
def test_it_can_be_ended(tiago: Driver, by: str) -> None:
    run = tiago.begin(4.0, 0.0)
    eventually(lambda: tiago.at[0] > 0.3, "a robot on its way")
    http = tiago.browser.http
    if by == "stop":
        assert http.post(f"{tiago.browser.root}tiago/actions/stop").status_code == 204
    elif by == "cancel":
        (cancel,) = tiago.browser.page(run).graph.objects(None, HYBRIT.action)
        assert http.post(str(cancel)).status_code == 204
    else:
        (base,) = tiago.browser.robot("tiago").graph.subjects(RDF.type, LF.Base)
        assert http.post(f"{base}/actions/drive", json={"linear": 0.1, "duration": 0.2}).status_code == 204
    ended(tiago.browser, run)
    assert tiago.state(run)["state"].rpartition("#")[2] == ("failed" if by == "stick" else "cancelled")
    eventually(lambda: tiago.base.velocity.linear == pytest.approx(0.0, abs=1e-3), "a standstill")
    assert tiago.at[0] < 2.5


def test_a_repeated_request_is_answered_by_its_first_invocation(tiago: Driver) -> None:
    """Also after the goal has been blocked, and after it was refused."""
    http, body = tiago.browser.http, {"position": point(1.0, 0.5)}
    tiago.ask(1.0, 0.5, prefer="dry-run")  # the shapes are prepared
    first = http.post(tiago.url, json=body, headers={"idempotency-key": '"once"'})
    tiago.end(first.headers["location"])
    tiago.end(tiago.begin(0.0, 0.0))
    put_object(tiago.browser, crate("crate", 1.0, 0.5, 0.3))
    again = http.post(tiago.url, json=body, headers={"idempotency-key": '"once"'})
    assert (again.status_code, again.headers["location"]) == (204, first.headers["location"])
    for _ in range(2):
        assert problem(http.post(tiago.url, json=body, headers={"idempotency-key": '"blocked"'}))[0] == 409
    assert tiago.at[:2] == pytest.approx((0.0, 0.0), abs=0.03)


def test_it_ends_when_somebody_takes_control(tiago: Driver) -> None:
    run = tiago.begin(4.0, 0.0)
    eventually(lambda: tiago.at[0] > 0.3, "a robot on its way")
    lease = str(tiago.browser.robot("tiago").one(LF.lease))
    taken = put(tiago.browser, lease, control("Ann", 60))
    ended(tiago.browser, run)
    assert tiago.state(run)["reason"] == "Ann has taken control of tiago."
    assert problem(tiago.ask(0.0, 0.0)) == (409, "controlled")
    assert tiago.at[0] < 3.0
    token = {"lock-token": taken.headers["lock-token"]}
    assert tiago.browser.http.delete(lease, headers=token).status_code == 204


def test_a_robot_without_a_placement_cannot_be_sent_anywhere(tiago: Driver) -> None:
    assert tiago.browser.http.delete(placement(tiago.browser, "tiago")).status_code == 204
    answer = tiago.ask(1.0, 0.0)
    assert problem(answer) == (409, "conflict") and "placement" in answer.json()["detail"]


def test_robots_that_follow_no_paths_do_not_offer_it(tiago: Driver) -> None:
    offered = {str(each) for each in tiago.browser.robot("tiago").graph.objects(None, HYBRIT.action)}
    assert tiago.url in offered


def test_what_is_no_thing_of_the_world_is_refused(tiago: Driver) -> None:
    assert problem(tiago.near("http://elsewhere.example/x"))[0] == 422
    assert problem(tiago.send({"near": f"{tiago.browser.root}nobody/"}))[0] == 422
    assert problem(tiago.send({"near": f"{tiago.browser.root}tiago/"}))[0] == 422
    assert problem(tiago.send({"near": f"{tiago.browser.root}pmb2/", "position": point(1, 1)}))[0] == 422
