"""The real fleet: five simulated robots and a gateway, as their own processes on free loopback ports."""

import contextlib
import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import hypothesis
import pytest
from browser import Browser, all_live
from running import Process, eventually, free_port, process
from second_try import pytest_terminal_summary  # noqa: F401 - a hook
from xdist.remote import Producer
from xdist.scheduler.loadscope import LoadScopeScheduling

# How long an example takes says nothing on a machine that does other things too. Where runs must agree, they do.
hypothesis.settings.register_profile("ours", deadline=None, derandomize="CI" in os.environ)
hypothesis.settings.load_profile("ours")

# Compiled once, and not again by each of hundreds of processes, whatever an image has set for its one.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A shell lets what it runs in the background ignore Ctrl-C, and whatever is started there inherits that.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROBOTS = ("baxter", "go2", "panda", "tiago", "ur5")
# These share the session's one fleet: in another process it would be a second one, and as long as the session is.
_OF_THE_FLEET = (
    "tests/requirements/",
    "tests/client/test_conform_fleet.py",
    "tests/client/test_fleet.py",
    "tests/face/test_access.py",
    "tests/gateway/face/test_forms.py",
    "tests/gateway/face/test_pages_of_robots.py",
    "tests/gateway/test_endpoint.py",
)
_ON_THEIR_OWN = (
    "tests/requirements/test_binary.py",
    "tests/requirements/test_settings.py",
    "tests/requirements/test_subscription_callbacks.py",
)


def _of_the_fleet(nodeid: str) -> bool:
    return nodeid.startswith(_OF_THE_FLEET) and not nodeid.startswith(_ON_THEIR_OWN)


@dataclass(frozen=True)
class RunningFleet:
    root: str
    zenoh: str
    gateway: Process
    agents: Process


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningFleet]:
    assert _of_the_fleet(os.environ["PYTEST_CURRENT_TEST"]), "a file that uses the fleet is named above"
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
        _running.append(running)
        yield running


_running: list[RunningFleet] = []


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest first: what shares the fleet, then all that starts processes; none is left alone with them.

    Of each folder one file after another: those of one mostly wait, those of another need a processor each.
    """
    files = dict.fromkeys(item.path for item in items)
    before = Counter[Path]()
    places = {path: before[path.parent] for path in files if not before.update([path.parent])}

    def rank(item: pytest.Item) -> tuple[bool, bool, int]:
        return not _of_the_fleet(item.nodeid), not item.get_closest_marker("fleet"), places[item.path]

    items.sort(key=rank)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A third of a core is free for the other tests as soon as all that need the fleet have had it.

    Not at the end of the last of those: it may fail and be run once more.
    """
    if "PYTEST_XDIST_WORKER" in os.environ and not _of_the_fleet(item.nodeid):
        for running in _running:
            running.agents.stop()
            running.gateway.stop()


@pytest.fixture(scope="session")
def browser(fleet: RunningFleet) -> Iterator[Browser]:
    with contextlib.closing(Browser(fleet.root)) as browser:
        yield browser


class Scheduling(LoadScopeScheduling):
    """Beside each other run files, so that what a file sets up is set up once, and all that share the one fleet."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        return "the fleet" if _of_the_fleet(file) else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Scheduling:
    return Scheduling(config, log)
