"""The real fleet: five simulated robots and a gateway, as their own processes on free loopback ports."""

from collections.abc import Iterator
from dataclasses import dataclass

import httpx
import pytest
from browser import LF, Browser
from rdflib import URIRef
from running import Process, eventually, free_port, process

ROBOTS = ("baxter", "go2", "panda", "tiago", "ur5")


@dataclass(frozen=True)
class RunningFleet:
    root: str
    zenoh: str
    gateway: Process
    agents: Process

    def browser(self) -> Browser:
        return Browser(self.root)


@pytest.fixture(scope="session")
def fleet() -> Iterator[RunningFleet]:
    port, zenoh = free_port(), f"tcp/127.0.0.1:{free_port()}"
    with (
        process("-m", "gateway", "--port", str(port), "--zenoh-listen", zenoh) as gateway,
        process("-m", "agents", *(f"--robot={name}" for name in ROBOTS), "--connect", zenoh) as agents,
    ):
        gateway.said("serving")
        running = RunningFleet(f"http://127.0.0.1:{port}/", zenoh, gateway, agents)
        eventually(lambda: _all_moving(running), f"five live robots\n{gateway.output}\n{agents.output}")
        yield running


@pytest.fixture(scope="session")
def browser(fleet: RunningFleet) -> Browser:
    return fleet.browser()


def _all_moving(running: RunningFleet) -> bool:
    browser = running.browser()
    try:
        pages = [browser.page(str(url)) for url in _robots(browser)]
    except httpx.TransportError:
        return False
    return len(pages) == len(ROBOTS) and all(
        page.graph.value(page.iri, LF.lastFrame) not in (None, LF.unknown) and page.graph.value(page.iri, LF.rootLink)
        for page in pages
    )


def _robots(browser: Browser) -> list[object]:
    from browser import LDP

    return list(browser.page(browser.root).graph.objects(URIRef(browser.root), LDP.contains))
