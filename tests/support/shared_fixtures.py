"""Fixtures of all tests: virtual time, and a fleet of five simulated robots with joints that move and a gateway."""

import asyncio
import contextlib
import gc
import inspect
import logging
import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from browser import Browser, all_live
from failure_reports import pytest_runtest_makereport  # noqa: F401 - a hook
from properties import load_profile
from running import PATIENCE_S, Process, eventually, free_port, process
from second_try import add_option, pytest_itemcollected, pytest_terminal_summary  # noqa: F401 - hooks
from virtual.client import clients_in_memory
from virtual.loop import virtual_time

load_profile()

# Collection makes hundreds of thousands of objects that stay until the end: no garbage collection looks at them.
gc.disable()

# Let child processes write bytecode, even if the image disables it: hundreds of them would compile everything again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A shell makes its background processes ignore Ctrl-C, and their children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROBOTS = ("baxter", "go2", "panda", "tiago", "ur5")
MOST_WITH_PROCESSES = 120


def pytest_addoption(parser: pytest.Parser) -> None:
    add_option(parser)
    parser.addoption("--seed", type=int, default=0, help="of all chance on virtual time; not 0: of latencies as well")


@pytest.fixture(scope="module", autouse=True)
def _virtual(request: pytest.FixtureRequest) -> Iterator[None]:
    """Use virtual time and in-memory connections for test files with the mark ``virtual``."""
    if request.node.get_closest_marker("virtual") is None and "VIRTUAL" not in os.environ:
        yield
        return
    root = logging.getLogger()
    level = root.level
    root.setLevel(logging.INFO)  # as in the processes
    logging.getLogger("httpx").setLevel(logging.WARNING)
    try:
        with virtual_time(request.config.getoption("--seed")) as loop, clients_in_memory(loop):
            yield
    finally:
        root.setLevel(level)


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a coroutine function as a test: on virtual time in the loop of the test, otherwise in a loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None

    async def bounded() -> None:
        async with asyncio.timeout(PATIENCE_S):
            await pyfuncitem.obj(
                **{name: pyfuncitem.funcargs[name] for name in inspect.signature(pyfuncitem.obj).parameters}
            )

    asyncio.run(bounded())
    return True


@dataclass(frozen=True)
class RunningFleet:
    root: str
    zenoh: str
    gateway: Process
    agents: Process


@pytest.fixture(scope="module")
def fleet(
    _virtual: None, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[RunningFleet]:
    """Run a gateway and all robots of ``ROBOTS`` here, or those named in ``ROBOTS`` of the test file."""
    names = getattr(request.module, "ROBOTS", ROBOTS)
    port, zenoh = free_port(), f"tcp/127.0.0.1:{free_port()}"
    state = ("--state-dir", str(tmp_path_factory.mktemp("state")), "--callback-allow", "127.0.0.0/8")
    with (
        process("-m", "linked_fleet_gateway", "--port", str(port), "--zenoh-listen", zenoh, *state) as gateway,
        process("-m", "linked_fleet_agent", *(f"--robot={name}" for name in names), "--connect", zenoh) as agents,
    ):
        gateway.said("serving")
        running = RunningFleet(f"http://127.0.0.1:{port}/", zenoh, gateway, agents)
        with contextlib.closing(Browser(running.root)) as browser:
            eventually(lambda: all_live(browser, len(names)), "live robots")
        yield running


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order files so that those with processes come first, because they mostly wait, and folders alternate."""
    files = dict.fromkeys(item.path for item in items)
    before = Counter[Path]()
    places = {path: before[path.parent] for path in files if not before.update([path.parent])}

    def rank(item: pytest.Item) -> tuple[bool, int]:
        real = item.get_closest_marker("processes") is not None
        return not real, places[item.path]

    items.sort(key=rank)
    short = [item for item in items if item.get_closest_marker("processes") and not item.get_closest_marker("test_all")]
    if len(short) > MOST_WITH_PROCESSES:
        raise pytest.UsageError(
            f"{len(short)} tests of make test need processes, {MOST_WITH_PROCESSES} at most may: mark some test_all"
        )


def pytest_collection_finish() -> None:
    """Collect garbage again, in what tests make alone, and less often: they make much that lives as long as they do."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)
    gc.enable()


@pytest.fixture(scope="module")
def browser(fleet: RunningFleet) -> Iterator[Browser]:
    with contextlib.closing(Browser(fleet.root)) as browser:
        yield browser
