"""A gateway whose embedded server has damaged data or cannot start: it serves, and stops robots."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from browser import LF, Browser
from commanding import ENDED, WRIST, angle, arm, begun, ended, of_joint, of_robot, post, problem, put, slowly
from file_damage import DAMAGES, cut_tail, garble
from linked_fleet_valkey.damaged_data import DATA
from running import eventually
from small_fleet import Place, live

pytestmark = pytest.mark.processes
_TURN = 3.0  # rad, slowly: still moving when the stop comes


@dataclass
class Scene:
    """A place in which gateways start one after another, with one arm that waits for them."""

    place: Place
    arm: object

    @contextlib.contextmanager
    def gateway(self, state: Path) -> Iterator[tuple[Browser, list[str]]]:
        """Yield a browser and the lines that the gateway writes."""
        with replace(self.place, state=state).gateway() as (process, browser):
            live(browser, "ur5")
            yield browser, process.lines
        assert "Traceback" not in process.output, process.output


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    place = Place(tmp_path_factory.mktemp("none"))
    with arm(place.zenoh) as agent:
        yield Scene(place, agent)


def stops(browser: Browser, goal: float) -> str:
    """Stop a running motion; return its invocation, which was begun with the idempotency key "one"."""
    turned = begun(put(browser, of_joint(browser, WRIST), slowly(goal), **{"Idempotency-Key": "one"}))
    start = angle(browser, WRIST)

    def under_way() -> bool:
        page = browser.page(turned)
        assert page.one(LF.state) not in ENDED, page.graph.serialize()
        return abs(angle(browser, WRIST) - start) > 0.03

    eventually(under_way, f"{WRIST} moving")
    begun(post(browser, of_robot(browser, LF.StopRobot)))
    assert ended(browser, turned).one(LF.state) == LF.cancelled
    return turned


def metric(browser: Browser, name: str) -> float:
    lines = browser.http.get(browser.root + "metrics").text.splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith(name + " "))


@pytest.mark.parametrize(
    "kind",
    [
        "bytes flipped in the middle",
        *(pytest.param(name, marks=pytest.mark.test_all) for name in ("a base of garbage", "a manifest of garbage")),
    ],
)
def test_damaged_data_do_not_keep_a_gateway_from_stopping_robots(kind: str, scene: Scene, tmp_path: Path) -> None:
    """It is ready with a warning in the log, on pages and in a metric; the data is lost."""
    with scene.gateway(tmp_path) as (browser, _):
        before = stops(browser, _TURN)
        assert browser.http.get(browser.root + "health/ready").json() == {"status": "ready"}
        assert 'id="warning"' not in browser.http.get(browser.root, headers={"accept": "text/html"}).text
        assert metric(browser, "linked_fleet_redis_data_set_aside") == 0
    DAMAGES[kind](tmp_path / DATA)
    with scene.gateway(tmp_path) as (browser, lines):
        assert stops(browser, -_TURN) != before, "its idempotency key is forgotten"
        assert browser.http.get(before).status_code == 404
        ready = eventually(lambda: _if_ready(browser), "readiness")
        (warning,) = ready["warnings"]
        assert "idempotency keys" in warning and str(tmp_path) not in warning
        for url in (browser.root, browser.robot("ur5").url):
            assert 'id="warning"' in browser.http.get(url, headers={"accept": "text/html"}).text
        assert metric(browser, "linked_fleet_redis_data_set_aside") == 1
        assert any("ERROR" in line and "idempotency keys" in line for line in lines)


def test_a_tail_that_was_cut_off_costs_nothing(scene: Scene, tmp_path: Path) -> None:
    with scene.gateway(tmp_path) as (browser, _):
        before = stops(browser, _TURN)
    cut_tail(tmp_path / DATA)
    with scene.gateway(tmp_path) as (browser, _):
        assert browser.page(before).one(LF.state) == LF.cancelled
        assert eventually(lambda: _if_ready(browser), "readiness") == {"status": "ready"}


@pytest.mark.test_all
@pytest.mark.parametrize("types", [False, True], ids=["values", "types"])
def test_foreign_values_in_redis_do_not_prevent_stops(types: bool, scene: Scene, tmp_path: Path) -> None:
    """Valkey has no checksums for commands: damage inside a command reaches the gateway."""
    with scene.gateway(tmp_path) as (browser, _):
        stops(browser, _TURN)
    assert len(garble(tmp_path, types=types)) > 5
    with replace(scene.place, state=tmp_path).gateway() as (process, browser):
        live(browser, "ur5")
        begun(post(browser, of_robot(browser, LF.StopRobot)))
        begun(post(browser, f"{browser.root}actions/stopAll"))
        assert process.stop() == 0


def test_without_any_server_a_gateway_starts_and_stops_robots(scene: Scene, tmp_path: Path) -> None:
    """Motions are refused and stops executed, as during an outage; with Redis everything works again."""
    obstacle = tmp_path / "file"
    obstacle.touch()
    state = obstacle / "state"
    with scene.gateway(state) as (browser, lines):
        assert any("ERROR" in line and "--state-dir" in line for line in lines)
        refused = put(browser, of_joint(browser, WRIST), slowly(_TURN))
        assert (problem(refused), refused.headers["retry-after"]) == ((503, "not-read-yet"), "2")
        begun(post(browser, of_robot(browser, LF.StopRobot)))
        begun(post(browser, f"{browser.root}actions/stopAll"))
        said = browser.http.get(browser.root + "health/ready")
        assert (said.status_code, said.json()["reasons"]) == (503, ["Redis does not answer"])
        obstacle.unlink()
        eventually(lambda: _if_ready(browser), "readiness")
        stops(browser, _TURN)


def _if_ready(browser: Browser) -> dict[str, Any] | None:
    answer = browser.http.get(browser.root + "health/ready")
    return answer.json() if answer.status_code == 200 else None
