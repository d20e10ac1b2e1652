"""The network between a robot and its gateway fails: a network namespace whose link goes down and comes up again."""

import contextlib
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

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
from running import free_port, process
from small_fleet import Place, live, offline

pytestmark = pytest.mark.processes


def _ip(*words: str) -> None:
    subprocess.run(("ip", *words), check=True, capture_output=True, text=True)


@dataclass
class Network:
    """``name``: the namespace of the robot, to which the gateway has ``address``."""

    name: str
    link: str
    address: str
    robot: str

    def cut(self) -> None:
        _ip("link", "set", self.link, "down")

    def heal(self) -> None:
        _ip("link", "set", self.link, "up")


@pytest.fixture
def network() -> Iterator[Network]:
    number = os.getpid() % 250
    name, here, there = f"lf{os.getpid()}", f"lfa{os.getpid()}", f"lfb{os.getpid()}"
    # Addresses for documentation (RFC 5737), which nothing real has.
    found = Network(name, here, f"198.51.100.{number}", f"203.0.113.{number}")
    with contextlib.ExitStack() as undo:
        try:
            _ip("netns", "add", name)
            undo.callback(_ip, "netns", "del", name)
            _ip("link", "add", here, "type", "veth", "peer", "name", there, "netns", name)
        except (OSError, subprocess.CalledProcessError) as error:
            said = error.stderr if isinstance(error, subprocess.CalledProcessError) else error
            pytest.skip(f"no network namespaces here, which need to be root: {str(said).strip()}")
        _ip("address", "add", f"{found.address}/32", "peer", f"{found.robot}/32", "dev", here)
        _ip("link", "set", here, "up")
        _ip("-n", name, "address", "add", f"{found.robot}/32", "peer", f"{found.address}/32", "dev", there)
        _ip("-n", name, "link", "set", there, "up")
        _ip("-n", name, "link", "set", "lo", "up")
        yield found


def test_a_robot_whose_network_fails_holds_and_comes_back(tmp_path: Path, network: Network) -> None:
    """By itself, and it reports that afterwards. Requests made meanwhile never run when the network is back."""
    place = Place(tmp_path, zenoh=f"tcp/{network.address}:{free_port()}")
    agent = ("-m", "linked_fleet_agent", "--robot=ur5", "--connect", place.zenoh)
    with (
        process(*place.command(), "--allow", "plain-zenoh") as gateway,
        process("tests/in_namespace.py", network.name, *agent),
        contextlib.closing(Browser(place.root)) as browser,
    ):
        gateway.said("serving")
        live(browser, "ur5")
        motion = begun(put(browser, of_joint(browser, PAN), slowly(3.0, speed=0.2)))
        moving(browser, PAN)
        network.cut()
        late = put(browser, of_joint(browser, WRIST), radian(0.5))
        assert problem(late) in ((504, "agent-silent"), (503, "offline"))
        offline(browser, "ur5")
        assert browser.page(motion).one(LF.state) == LF.unknown
        assert problem(put(browser, of_joint(browser, WRIST), radian(0.5))) == (503, "offline")
        network.heal()
        live(browser, "ur5")
        page = ended(browser, motion)
        assert (page.one(LF.state), "gateway lost" in reason(page)) == (LF.failed, True)
        assert angle(browser, WRIST) == pytest.approx(0.0, abs=STILL_RAD)
        held = angle(browser, PAN)
        assert held < 2.5
        begun(put(browser, of_joint(browser, WRIST), radian(0.5), prefer="wait=30"))
        assert angle(browser, PAN) == pytest.approx(held, abs=STILL_RAD)
