"""Streams over WebSockets: what opens one, what its samples do, and whatever ends it."""

import contextlib
import itertools
import json
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from browser import LDP, LF, Browser
from driven_base import Ideal
from linked_fleet_agent.planar import STANDING
from linked_fleet_agent.robots.of_components import RobotOfComponents
from running import Process, eventually
from small_fleet import Place, number, presence
from virtual.client import WebSocket
from virtual.loop import VirtualLoop, current
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
JSON = {"content-type": "application/json", "accept": "application/json"}


class Driver:
    """A program of a client, which sends back the robot's time that it was told last."""

    def __init__(self, loop: VirtualLoop, url: str, subprotocols: str = "lf.drive", **fields: str) -> None:
        self._loop = loop
        self.socket = WebSocket(loop, url, fields, subprotocols)
        self.told: dict[str, Any] = {}
        self.values: dict[str, Any] = {}
        self.hear()

    def hear(self) -> dict[str, Any]:
        """Take the next message."""
        self.told = json.loads(self.socket.recv(5))
        self.values |= self.told.get("values", {})
        return self.told

    def hear_all(self) -> None:
        """Take the messages that have come, and the next one."""
        with contextlib.suppress(TimeoutError):
            while True:
                self.told = json.loads(self.socket.recv(0.001))
                self.values |= self.told.get("values", {})

    def send(self, linear: float, angular: float = 0.0) -> None:
        self.socket.send(json.dumps({"seen": self.told["time"], "input": {"linear": linear, "angular": angular}}))

    def drive(self, linear: float, seconds: float) -> None:
        end_s = self._loop.time() + seconds
        while self._loop.time() < end_s:
            self.hear()
            self.send(linear)

    def ended(self) -> tuple[int, str]:
        """Return code and reason of the server's close."""
        with pytest.raises(ConnectionClosed):
            while True:
                self.hear()
        assert self.socket.close_reason is not None
        return self.socket.close_reason


class Hall:
    """A gateway and a cart that drives."""

    def __init__(self, loop: VirtualLoop, place: Place, gateway: Process, browser: Browser, base: Ideal) -> None:
        self.loop, self.place, self.gateway, self.browser, self.base = loop, place, gateway, browser, base
        self.robot = place.root + "cart/"
        self.action = self.robot + "mobile_base/actions/drive"

    @property
    def url(self) -> str:
        return self.action.replace("http", "ws", 1)

    def open(self, subprotocols: str = "lf.drive", **fields: str) -> Driver:
        return Driver(self.loop, self.url, subprotocols, **fields)

    def refused(self, subprotocols: str = "lf.drive", **fields: str) -> tuple[int, dict[str, Any]]:
        with pytest.raises(InvalidStatus) as caught:
            self.open(subprotocols, **fields)
        response = caught.value.response
        return response.status_code, json.loads(response.body or b"{}")

    def json(self, iri: str) -> Any:
        return self.browser.http.get(iri, headers=JSON).raise_for_status().json()

    def lease(self, holder: str, token: str = "", **more: Any) -> httpx.Response:
        headers = JSON | ({"lock-token": token} if token else {})
        body = {"holder": holder, "duration": 60} | more
        answer = self.browser.http.put(self.robot + "lease", json=body, headers=headers)
        assert answer.status_code in (204, 403, 409), answer.text
        return answer

    @property
    def speed(self) -> float:
        return self.base.sent[-1].linear

    def until(self, iri: str, state: str) -> dict[str, Any]:
        return eventually(lambda: (found := self.json(iri))["state"].endswith(state) and found, f"{iri} {state}")

    def stands(self) -> None:
        eventually(lambda: self.base.sent[-1] == STANDING, "a standstill")


@pytest.fixture
def hall(tmp_path: Path) -> Iterator[Hall]:
    loop = current()
    assert loop is not None
    place, base = Place(tmp_path), Ideal()
    robot = RobotOfComponents("Cart", base, measure_base=lambda: base.reading)
    with place.gateway() as (gateway, browser), serving_robot(place.zenoh, "cart", robot):
        found = Hall(loop, place, gateway, browser, base)
        eventually(lambda: browser.http.get(found.action).status_code == 200, "the cart")
        yield found


def test_the_action_says_that_it_takes_a_stream(hall: Hall) -> None:
    page = hall.browser.page(hall.action)
    assert str(page.one(LF.streamProtocol)) == "lf.drive"
    limits = [number(page, LF.term(name)) for name in ("ageLimit", "silenceLimit", "endsAfter")]
    assert limits == [0.15, 0.2, 2.0]
    td = hall.browser.http.get(hall.robot + "mobile_base", headers={"accept": "application/td+json"}).json()
    forms = td["actions"]["drive"]["forms"]
    assert [(each["href"], each["op"]) for each in forms if each.get("subprotocol") == "lf.drive"] == [
        (hall.url, "invokeaction")
    ]
    api = hall.browser.http.get(hall.place.root + "openapi.json", headers={"accept": "application/json"}).json()
    (drive,) = (path for path in api["paths"] if path.endswith("/actions/drive"))
    assert "the subprotocol lf.drive" in api["paths"][drive]["post"]["description"]


def test_samples_drive_the_robot_as_one_invocation(hall: Hall) -> None:
    driver = hall.open()
    assert driver.socket.subprotocol == "lf.drive"
    invocation = driver.told["invocation"]
    driver.drive(0.5, 1.0)
    assert hall.speed == 0.5
    assert driver.told["state"] == "running"
    assert driver.values["twist"]["linear"] == pytest.approx(0.5)
    assert driver.values["pose"]["x"] > 0.1
    assert set(driver.told["dropped"].values()) == {0}
    running = hall.json(invocation)
    assert running["state"].endswith("running")
    container = hall.browser.page(hall.action + "/invocations")
    assert [str(each) for each in container.graph.objects(container.iri, LDP.contains)] == [invocation]
    driver.socket.close()
    ended = hall.until(invocation, "cancelled")
    assert ended["reason"] == "its client has closed the stream"
    assert ended["samples"]["applied"] == pytest.approx(60, abs=3)
    hall.stands()


def test_messages_come_sixty_times_a_second_at_most_and_while_nothing_changes(hall: Hall) -> None:
    driver = hall.open()
    began_s = hall.loop.time()
    times = [driver.hear()["time"] for _ in range(60)]
    assert times == sorted(times)
    assert hall.loop.time() - began_s == pytest.approx(1.0, abs=0.05)
    assert times[-1] * 1e9 <= hall.loop.clock.monotonic_ns


def test_silence_brakes_and_then_ends_the_stream(hall: Hall) -> None:
    driver = hall.open()
    driver.drive(0.5, 1.0)
    silent_s = hall.loop.time()
    hall.loop.run_until(lambda: hall.speed < 0.5, "braking")
    assert hall.loop.time() - silent_s == pytest.approx(0.2, abs=0.05)
    hall.stands()
    driver.drive(0.3, 0.3)
    assert hall.speed > 0
    code, reason = driver.ended()
    assert (code, reason) == (1000, "failed: no sample came for 2 s")
    assert driver.told["ended"]
    hall.stands()


def test_samples_that_saw_the_robot_long_ago_move_nothing(hall: Hall) -> None:
    driver = hall.open()
    old = dict(driver.told)
    hall.loop.run_for(0.2)
    for _ in range(40):
        driver.hear()
        driver.socket.send(json.dumps({"seen": old["time"], "input": {"linear": 1.0}}))
    driver.hear_all()
    assert driver.told["dropped"]["late"] > 20
    assert driver.told["applied"] == 0
    assert set(hall.base.sent) == {STANDING}


def test_a_time_that_has_not_come_yet_moves_nothing(hall: Hall) -> None:
    driver = hall.open()
    for _ in range(20):
        driver.hear()
        driver.socket.send(json.dumps({"seen": driver.told["time"] + 0.5, "input": {"linear": 1.0}}))
    driver.hear_all()
    assert driver.told["dropped"]["future"] > 10
    assert set(hall.base.sent) == {STANDING}


@pytest.mark.parametrize(
    ("message", "code", "said"),
    [
        ("go", 1007, "seen"),
        (b"\xff", 1007, "seen"),
        ("[]", 1007, "seen"),
        ('{"seen": 1}', 1007, "input"),
        ('{"seen": "now", "input": {}}', 1007, "seen"),
        ('{"seen": -1, "input": {}}', 1007, "seen"),
        ('{"seen": 1e300, "input": {}}', 1007, "seen"),
        ('{"seen": 1, "input": {}, "speed": 2}', 1007, "speed"),
        ('{"seen": 1, "input": {"linear": 5}}', 1007, "linear"),
        ('{"seen": 1, "input": {"linear": NaN}}', 1007, "seen"),
        ('{"seen": 1, "input": {"sideways": 1}}', 1007, "sideways"),
        ('{"seen": 1, "input": null}', 1007, "null"),
        ('{"seen": 1, "input": {"linear": 0}}' + " " * 2048, 1009, ""),
    ],
)
def test_what_is_no_sample_ends_the_stream_with_a_reason(hall: Hall, message: Any, code: int, said: str) -> None:
    driver = hall.open()
    invocation = driver.told["invocation"]
    driver.drive(0.5, 0.5)
    driver.socket.send(message)
    ended, reason = driver.ended()
    assert ended == code
    assert said in reason
    hall.until(invocation, "cancelled")
    hall.stands()


def test_a_flood_ends_the_stream_and_is_not_passed_on(hall: Hall) -> None:
    driver = hall.open()
    invocation = driver.told["invocation"]
    for _ in range(500):
        driver.send(0.5)
    assert driver.ended() == (1008, "Send at most 200 samples a second.")
    assert hall.until(invocation, "cancelled").get("samples", {}).get("applied", 0) < 50


def test_of_samples_that_come_at_once_the_newest_is_applied(hall: Hall) -> None:
    driver = hall.open()
    for speed in itertools.chain([0.9] * 50, [0.1]):
        driver.send(speed)
    hall.loop.run_for(0.15)
    assert hall.speed == pytest.approx(0.1)
    driver.hear_all()
    assert driver.told["dropped"]["superseded"] > 20


@pytest.mark.parametrize("way", ["stop", "cancel"])
def test_a_stop_and_a_cancellation_end_the_stream(hall: Hall, way: str) -> None:
    driver = hall.open()
    invocation = driver.told["invocation"]
    driver.drive(0.5, 0.5)
    target = hall.robot + "actions/stop" if way == "stop" else invocation + "/actions/cancel"
    assert hall.browser.http.post(target).status_code == 204
    driver.send(1.0)
    _, reason = driver.ended()
    assert reason.startswith("cancelled: ")
    hall.stands()
    assert max(each.linear for each in hall.base.sent) <= 0.5


def test_it_is_refused_before_the_upgrade_where_the_same_post_is(hall: Hall) -> None:
    assert hall.refused("lf.turtle")[0] == 406
    assert hall.refused(prefer="dry-run")[0] == 400
    assert hall.refused("lf.drive, lf.lease.nonsense")[0] == 400
    assert hall.refused(**{"lock-token": "nonsense"})[0] == 400
    hall.base.prevents_motion = "the gate is open"
    hall.loop.run_for(0.1)
    status, said = hall.refused()
    assert (status, "mobile_base: the gate is open" in said["detail"]) == (409, True)
    posted = hall.browser.http.post(hall.action, json={}, headers=JSON)
    assert (posted.status_code, posted.json()["detail"]) == (409, said["detail"])


def test_it_is_refused_for_a_robot_that_is_offline(hall: Hall) -> None:
    with serving_robot(hall.place.zenoh, "other", RobotOfComponents("Other", Ideal())):
        action = hall.place.root + "other/mobile_base/actions/drive"
        eventually(lambda: hall.browser.http.get(action).status_code == 200, "the other")
    eventually(lambda: hall.browser.http.post(action, json={}, headers=JSON).status_code == 503, "offline")
    with pytest.raises(InvalidStatus) as caught:
        Driver(hall.loop, action.replace("http", "ws", 1))
    assert caught.value.response.status_code == 503


def test_actions_without_a_stream_have_no_such_websocket(hall: Hall) -> None:
    with pytest.raises(InvalidStatus) as caught:
        Driver(hall.loop, (hall.robot + "actions/stop").replace("http", "ws", 1))
    assert caught.value.response.status_code in (406, 409)


def test_the_lease_of_another_refuses_a_stream_and_ones_own_opens_it(hall: Hall) -> None:
    token = hall.lease("Ann").headers["lock-token"]
    status, said = hall.refused()
    assert (status, said["holder"]) == (409, "Ann")
    driver = hall.open(**{"lock-token": token})
    driver.drive(0.5, 0.5)
    assert driver.told["driver"] == "Ann"
    driver.socket.close()
    uuid = token.strip("<>").removeprefix("urn:uuid:")
    browser_driver = hall.open(f"lf.drive, lf.lease.{uuid}")
    assert browser_driver.socket.subprotocol == "lf.drive"
    browser_driver.drive(0.5, 0.5)
    assert hall.speed > 0.4


def test_the_end_of_its_lease_ends_a_stream(hall: Hall) -> None:
    token = hall.lease("Ann").headers["lock-token"]
    driver = hall.open(**{"lock-token": token})
    driver.drive(0.5, 0.5)
    released = hall.browser.http.delete(hall.robot + "lease", headers={"lock-token": token})
    assert released.status_code == 204
    assert "the control lease has ended" in driver.ended()[1]
    hall.stands()


def test_a_lease_that_somebody_takes_ends_a_stream_without_one(hall: Hall) -> None:
    driver = hall.open()
    driver.drive(0.5, 0.5)
    assert hall.lease("Ann").status_code == 204
    assert driver.ended()[1] == "Ann has taken control"
    hall.stands()


def test_a_person_takes_control_from_a_program_and_never_the_other_way_round(hall: Hall) -> None:
    token = hall.lease("Planner").headers["lock-token"]
    program = hall.open(**{"lock-token": token})
    program.drive(0.5, 0.5)
    assert (program.told["driver"], program.told["priority"]) == ("Planner", "program")
    proof = hall.lease("Ann", priority="person").headers["lock-token"]
    assert program.ended()[1].endswith("Ann, a person, has taken control")
    assert str(hall.browser.page(hall.robot + "lease").one(LF.priority)) == "person"
    person = hall.open(**{"lock-token": proof})
    person.drive(-0.5, 0.8)
    assert hall.speed == -0.5
    assert (person.told["driver"], person.told["priority"]) == ("Ann", "person")
    for holder, priority in (("Planner", "program"), ("Ben", "person")):
        refused = hall.lease(holder, token if holder == "Planner" else "", priority=priority)
        assert refused.status_code == 409
        assert refused.json()["detail"].startswith("Ann controls cart until ")
        assert ", as a person;" in refused.json()["detail"]
    person.drive(-0.5, 0.2)
    assert person.told["state"] == "running"


def test_a_newer_stream_takes_over(hall: Hall) -> None:
    first = hall.open()
    first.drive(0.5, 0.5)
    second = hall.open()
    assert first.ended()[1].startswith("preempted: ")
    second.drive(-0.5, 0.8)
    assert hall.speed == -0.5


def test_a_gateway_that_dies_is_silence(hall: Hall) -> None:
    driver = hall.open()
    driver.drive(0.5, 0.5)
    died_s = hall.loop.time()
    hall.gateway.send(signal.SIGKILL)
    hall.loop.run_until(lambda: hall.speed < 0.5, "braking")
    assert hall.loop.time() - died_s <= 0.2 + 0.1
    hall.stands()


def test_a_gateway_that_hangs_brakes_the_robot_and_nothing_that_waited_moves_it(hall: Hall) -> None:
    driver = hall.open()
    driver.drive(0.5, 0.5)
    hung_s = hall.loop.time()
    hall.gateway.send(signal.SIGSTOP)
    for _ in range(20):
        driver.send(1.0)
    hall.loop.run_until(lambda: hall.speed < 0.5, "braking")
    assert hall.loop.time() - hung_s <= 0.2 + 0.1
    hall.stands()
    hall.gateway.send(signal.SIGCONT)
    fastest = max(each.linear for each in hall.base.sent)
    hall.loop.run_for(0.2)
    assert max(each.linear for each in hall.base.sent) == fastest <= 0.5
    assert presence(hall.browser, "cart") is not None
