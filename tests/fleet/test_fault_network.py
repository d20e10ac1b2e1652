"""The network between a robot and its gateway fails: the link between two network namespaces goes down and up again."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from bench.namespaces import Link, add, full_name, link, namespaces
from bench.table import UnavailableError
from browser import LF, Browser
from commanding import (
    PAN,
    STILL_RAD,
    WRIST,
    angle,
    begun,
    ended,
    moving,
    of_joint,
    problem,
    put,
    radian,
    reason,
    slowly,
)
from in_namespace import entered
from running import eventually, free_port, process
from scene_client import put_robot
from small_fleet import Place, live, offline

pytestmark = pytest.mark.processes
JSON = {"accept": "application/json"}


@pytest.fixture
def cable() -> Iterator[Link]:
    """Lay a cable from the namespace of the gateway, which the test enters, to that of the robot."""
    try:
        with namespaces():
            add("robot")
            with entered(full_name("hub")):
                yield link(0, "hub", "robot")
    except UnavailableError as error:
        pytest.skip(str(error))


DRIVE = {"position": {"x": 8.0, "y": 0.0, "unit": "http://qudt.org/vocab/unit/M"}}


def _begun(answer: httpx.Response) -> str | None:
    return answer.headers["location"] if answer.status_code == 204 else None


def _driven_m(browser: Browser) -> float:
    """Return how far the cart has come by its odometry, as the gateway knows it."""
    value = browser.http.get(f"{browser.root}cart/mobile_base", headers=JSON)
    return float(value.json()["pose"]["x"])


def test_a_base_on_its_way_to_a_goal_brakes_and_does_not_go_on_by_itself(tmp_path: Path, cable: Link) -> None:
    """It stands before the cable is back, and its drive ends with the reason."""
    place = Place(tmp_path, zenoh=f"tcp/{cable.address}:{free_port()}")
    with (
        process(*place.command(), "--allow", "plain-zenoh") as gateway,
        process(
            "tests/support/in_namespace.py", full_name("robot"), "examples/base.py", "--connect", place.zenoh
        ) as it,
        contextlib.closing(Browser(place.root)) as browser,
    ):
        gateway.said("serving")
        live(browser, "cart")
        put_robot(browser, "cart", 0, 0, 0)
        action = f"{place.root}cart/actions/driveTo"
        drive = eventually(lambda: _begun(browser.http.post(action, json=DRIVE)), "a drive")
        eventually(lambda: _driven_m(browser) > 0.3, "a base on its way")
        cable.cut()
        offline(browser, "cart")
        it.said("holds")
        cable.heal()
        it.said("takes commands again")
        live(browser, "cart")
        page = ended(browser, drive)
        assert page.one(LF.state) == LF.failed
        assert "gateway lost" in reason(page), reason(page)
        stood_m = _driven_m(browser)
        assert stood_m < 6.0
        assert (
            browser.http.post(f"{place.root}cart/mobile_base/actions/drive", json={"duration": 0.5}).status_code == 204
        )
        eventually(lambda: _begun(browser.http.post(action, json=DRIVE)), "another drive")
        assert _driven_m(browser) == pytest.approx(stood_m, abs=0.3)


def test_a_robot_whose_network_fails_holds_and_comes_back(tmp_path: Path, cable: Link) -> None:
    """By itself, and it reports that afterwards. Requests made meanwhile never run when the network is back."""
    place = Place(tmp_path, zenoh=f"tcp/{cable.address}:{free_port()}")
    agent = ("-m", "linked_fleet_agent", "--robot=ur5", "--connect", place.zenoh)
    with (
        process(*place.command(), "--allow", "plain-zenoh") as gateway,
        process("tests/support/in_namespace.py", full_name("robot"), *agent) as robot,
        contextlib.closing(Browser(place.root)) as browser,
    ):
        gateway.said("serving")
        live(browser, "ur5")
        motion = begun(put(browser, of_joint(browser, PAN), slowly(3.0, speed=0.2)))
        moving(browser, PAN)
        cable.cut()
        late = put(browser, of_joint(browser, WRIST), radian(0.5))
        assert problem(late) in ((504, "agent-silent"), (503, "offline"))
        offline(browser, "ur5")
        assert browser.page(motion).one(LF.state) == LF.unknown
        assert problem(put(browser, of_joint(browser, WRIST), radian(0.5))) == (503, "offline")
        cable.heal()
        robot.said("takes commands again")  # it hears from the gateway some time after the gateway hears from it
        live(browser, "ur5")
        page = ended(browser, motion)
        assert (page.one(LF.state), "gateway lost" in reason(page)) == (LF.failed, True)
        assert angle(browser, WRIST) == pytest.approx(0.0, abs=STILL_RAD)
        held = angle(browser, PAN)
        assert held < 2.5
        begun(put(browser, of_joint(browser, WRIST), radian(0.5), prefer="wait=30"))
        assert angle(browser, PAN) == pytest.approx(held, abs=STILL_RAD)
