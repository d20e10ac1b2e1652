"""An HTTP client that knows only HTTP and RDF, and finds everything by links."""

from collections.abc import Callable
from dataclasses import dataclass

import httpx
import rdflib
from rdflib import RDF, URIRef

from connections import http_client
from graphs import read

HYBRIT = rdflib.Namespace("https://hybr-it-projekt.de/ns/hybr-it#")
ROS = rdflib.Namespace("http://ros.org/#")
LF = rdflib.Namespace("https://w3id.org/linked-fleet#")
LDP = rdflib.Namespace("http://www.w3.org/ns/ldp#")
VOM = rdflib.Namespace("http://vocab.arvida.de/2015/06/vom/vocab#")
MATHS = rdflib.Namespace("http://vocab.arvida.de/2015/06/maths/vocab#")
HTTP = rdflib.Namespace("http://www.w3.org/2011/http#")
SPATIAL = rdflib.Namespace("http://vocab.arvida.de/2015/06/spatial/vocab#")
DCTERMS, RDFS, SH, PROV, SOSA = rdflib.DCTERMS, rdflib.RDFS, rdflib.SH, rdflib.PROV, rdflib.SOSA

TURTLE = "text/turtle"


@dataclass(frozen=True)
class Page:
    """A resource as served in Turtle."""

    url: str
    response: httpx.Response
    graph: rdflib.Graph

    @property
    def iri(self) -> URIRef:
        return URIRef(self.url)

    @property
    def types(self) -> set[object]:
        return set(self.graph.objects(self.iri, RDF.type))

    def one(self, predicate: URIRef) -> URIRef:
        (value,) = self.graph.objects(self.iri, predicate)
        return URIRef(str(value))

    def property(self, kind: URIRef) -> URIRef:
        """Return the property of this class."""
        (found,) = (
            each for each in self.graph.objects(self.iri, HYBRIT.property) if (each, RDF.type, kind) in self.graph
        )
        return URIRef(str(found))


class Browser:
    """Gets resources below one root; every URL that it uses was found in a response."""

    def __init__(self, root: str) -> None:
        self.root = root
        self.http = http_client()
        self._names: dict[str, str] = {}
        self._found: dict[object, str] = {}

    def close(self) -> None:
        self.http.close()

    def page(self, url: str) -> Page:
        response = self.http.get(url)
        assert response.status_code == 200, f"{url}: {response.status_code} {response.text[:500]}"
        is_turtle = response.headers["content-type"].startswith(TURTLE)
        return Page(url, response, read(response.content, url) if is_turtle else rdflib.Graph())

    def robots(self) -> list[Page]:
        members = self.page(self.root).graph.objects(URIRef(self.root), LDP.contains)
        return [self.page(str(url)) for url in members]

    def robot(self, title_or_name: str) -> Page:
        """Return the robot with this identifier, found from the root."""
        for url in self.page(self.root).graph.objects(URIRef(self.root), LDP.contains):
            # A URL known to be that of another robot need not be requested again.
            if self._names.get(str(url), title_or_name) == title_or_name:
                page = self.page(str(url))
                name = self._names[page.url] = str(page.graph.value(page.iri, DCTERMS.identifier))
                if name == title_or_name:
                    return page
        raise AssertionError(f"no robot {title_or_name}")

    def found(self, what: object, find: Callable[[], str]) -> str:
        """Return a URL that is found by links once and then remembered."""
        if what not in self._found:
            self._found[what] = find()
        return self._found[what]

    def part(self, robot: str, title: str) -> Page:
        page = self.robot(robot)
        for url in page.graph.objects(page.iri, DCTERMS.hasPart):
            if str(page.graph.value(url, DCTERMS.title)) == title:
                return self.page(str(url))
        raise AssertionError(f"no part {title} in {robot}")

    def action(self, thing: Page, kind: URIRef) -> str:
        """Return the action of this class that a thing links."""
        for url in thing.graph.objects(thing.iri, HYBRIT.action):
            if kind in self.page(str(url)).types:
                return str(url)
        raise AssertionError(f"{thing.url} has no action of the kind {kind}")


def all_live(browser: Browser, count: int) -> bool:
    """Return True if ``count`` robots are listed, described, and have sent a frame."""
    try:
        pages = browser.robots()
    except httpx.TransportError:
        return False
    described = [page for page in pages if (page.iri, LF.rootLink, None) in page.graph]
    return len([page for page in described if page.one(LF.lastFrame) != LF.unknown]) == count


def links(response: httpx.Response, rel: str) -> list[str]:
    """Return the targets of the Link header with this relation."""
    return [str(target) for target, found in _parsed(response) if found == rel]


def _parsed(response: httpx.Response) -> list[tuple[str, str]]:
    found = []
    for value in response.headers.get_list("link"):
        for part in value.split(", <"):
            target, _, parameters = part.lstrip("<").partition(">")
            rel = parameters.split('rel="')[1].split('"')[0]
            found.append((target, rel))
    return found
