"""A gateway for one test, and requests to the robots in it, all found by links."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pyshacl
import rdflib
from rdflib import URIRef

from browser import HYBRIT, LF, SH, VOM, Browser, Page
from running import Process, eventually, free_port, process
from walk import Walk, walk

_TURTLE = {"content-type": "text/turtle"}
_BODY = "@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .\n"


@dataclass
class Place:
    """The ports and the state of a gateway, which may be started there repeatedly."""

    state: Path
    port: int = field(default_factory=free_port)
    zenoh: str = field(default_factory=lambda: f"tcp/127.0.0.1:{free_port()}")

    @property
    def root(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def command(self) -> tuple[str, ...]:
        state = ("--state-dir", str(self.state), "--callback-allow", "127.0.0.0/8")
        return ("-m", "linked_fleet_gateway", "--port", str(self.port), "--zenoh-listen", self.zenoh, *state)

    @contextlib.contextmanager
    def gateway(self) -> Iterator[tuple[Process, Browser]]:
        with process(*self.command()) as gateway, contextlib.closing(Browser(self.root)) as browser:
            gateway.said("serving")
            yield gateway, browser

    def ur5(self, *more: str) -> contextlib.AbstractContextManager[Process]:
        return self.robot("ur5", *more)

    def robot(self, name: str, *more: str) -> contextlib.AbstractContextManager[Process]:
        return process("-m", "linked_fleet_agent", f"--robot={name}", "--connect", self.zenoh, *more)


def presence(browser: Browser, name: str) -> Page | None:
    """Return the robot's page, None while the fleet does not list it."""
    try:
        return browser.robot(name)
    except AssertionError:
        return None


def live(browser: Browser, name: str) -> Page:
    def probe() -> Page | None:
        page = presence(browser, name)
        if page is None or page.one(LF.presence) != LF.online or page.one(LF.lastFrame) == LF.unknown:
            return None
        return page

    return eventually(probe, f"{name} live")


def offline(browser: Browser, name: str) -> Page:
    def probe() -> Page | None:
        page = presence(browser, name)
        return page if page is not None and page.one(LF.presence) == LF.offline else None

    return eventually(probe, f"{name} offline")


def faulty(browser: Browser, name: str) -> str:
    def probe() -> str | None:
        page = presence(browser, name)
        return page and str(page.graph.value(page.iri, LF.fault) or "")

    return eventually(probe, f"a fault of {name}")


def property_page(browser: Browser, name: str, part: str, predicate: URIRef) -> Page:
    return browser.page(str(browser.part(name, part).one(predicate)))


def number(page: Page, predicate: URIRef) -> float | URIRef:
    """Return the number of a scalar, or lf:unknown."""
    value = page.graph.value(page.graph.value(page.iri, predicate), VOM.numericalValue)
    return value if isinstance(value, URIRef) else float(str(value))


def move(browser: Browser, action: str, radian: float, **headers: str) -> httpx.Response:
    body = _BODY + f"<> vom:numericalValue {radian} ; vom:unit unit:RAD ."
    return browser.http.put(action, content=body, headers=_TURTLE | headers)


def whole(browser: Browser) -> Walk:
    """Walk everything by links, and validate each thing and property against its own blueprint."""
    tree = walk(browser.root, browser.http)
    for page in tree:
        if page.kind in ("fleet", "robot", "joint", "link", "property"):
            (blueprint,) = [str(b) for b in page.graph.objects(page.iri, HYBRIT.blueprint) if str(b) in tree.pages]
            shapes = tree.pages[blueprint].graph
            types = set(page.graph.objects(page.iri, rdflib.RDF.type))
            own = {page.iri} if shapes.value(None, SH.targetNode, page.iri) == URIRef(f"{blueprint}#shape") else types
            targets = {*shapes.objects(None, SH.targetClass), *shapes.objects(None, SH.targetNode)}
            assert targets & own, f"{page.url} is no target"
            conforms, _, text = pyshacl.validate(page.graph, shacl_graph=shapes, inference="none")
            assert conforms, f"{page.url}\n{text}"
    return tree
