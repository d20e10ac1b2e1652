"""The real fleet: five simulated robots and a gateway, as their own processes on free loopback ports."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass

import hypothesis
import pytest
from browser import Browser, all_live
from running import Process, eventually, free_port, process

# How long an example takes says nothing on a machine that does other things too. Where runs must agree, they do.
hypothesis.settings.register_profile("ours", deadline=None, derandomize="CI" in os.environ)
hypothesis.settings.load_profile("ours")

ROBOTS = ("baxter", "go2", "panda", "tiago", "ur5")


@dataclass(frozen=True)
class RunningFleet:
    root: str
    zenoh: str
    gateway: Process
    agents: Process


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningFleet]:
    port, zenoh = free_port(), f"tcp/127.0.0.1:{free_port()}"
    state = ("--state-dir", str(tmp_path_factory.mktemp("state")), "--callback-allow", "127.0.0.0/8")
    with (
        process("-m", "gateway", "--port", str(port), "--zenoh-listen", zenoh, *state) as gateway,
        process("-m", "agents", *(f"--robot={name}" for name in ROBOTS), "--connect", zenoh) as agents,
    ):
        gateway.said("serving")
        running = RunningFleet(f"http://127.0.0.1:{port}/", zenoh, gateway, agents)
        with contextlib.closing(Browser(running.root)) as browser:
            eventually(lambda: all_live(browser, len(ROBOTS)), "five live robots")
        yield running


@pytest.fixture(scope="session")
def browser(fleet: RunningFleet) -> Iterator[Browser]:
    with contextlib.closing(Browser(fleet.root)) as browser:
        yield browser


@pytest.hookimpl(tryfirst=True)  # the marks are read in this very hook
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Beside each other run files, so that what a file sets up is set up once, and all that share the one fleet."""
    for item in items:
        shared = "fleet" in getattr(item, "fixturenames", ())
        item.add_marker(pytest.mark.xdist_group("the fleet" if shared else item.location[0]))
