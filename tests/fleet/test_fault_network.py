"""The network between a robot and its gateway fails: the link between two network namespaces goes down and up again."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

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
from running import free_port, process
from small_fleet import Place, live, offline

pytestmark = pytest.mark.processes


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
