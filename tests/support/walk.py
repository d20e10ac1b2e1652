"""The whole tree from the root by links only: Link headers, link sets and IRIs in representations."""

import contextlib
import gc
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import httpx
import pyoxigraph
import rdflib
from rdflib import RDF, URIRef

from browser import HYBRIT, LDP, LF, ROS, TURTLE, links
from graphs import graph_of, triples_of

WALKED = ("panda", "ur5")
"""Revolute and prismatic joints, a gripper, a mimic joint; all five robots have 6,000 resources."""
_THINGS = {"fleet": LF.Fleet, "robot": LF.Robot, "joint": LF.Joint, "link": ROS.Link}
_OTHERS = {
    "property": HYBRIT.Property,
    "action": HYBRIT.Action,
    "blueprint": LF.Blueprint,
    "invocation": LF.Invocation,
    "subscription": HYBRIT.Subscription,
    "container": LDP.Container,
}


@dataclass
class Visited:
    """One resource of the tree with its response."""

    url: str
    response: httpx.Response
    kind: str
    targets: set[str]
    """The links to resources of the same tree."""

    def says(self, response: httpx.Response) -> bool:
        """Return True if the response is byte-identical."""
        ours, other = self.response, response
        return ours.content == other.content and ours.headers.get("link") == other.headers.get("link")

    @cached_property
    def graph(self) -> rdflib.Graph:
        """The rdflib graph, parsed on demand: parsing that of a whole fleet takes a minute."""
        return graph_of(self.triples())

    def triples(self) -> list[pyoxigraph.Triple]:
        """The triples, parsed each time, and a dozen times as fast."""
        return _triples(self.url, self.response)

    @property
    def iri(self) -> URIRef:
        return URIRef(self.url)

    @property
    def is_thing(self) -> bool:
        return self.kind in _THINGS


@dataclass
class Walk:
    """Every reachable resource, in the order of discovery."""

    root: str
    pages: dict[str, Visited] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Visited]:
        return iter(self.pages.values())

    def things(self) -> list[Visited]:
        return [page for page in self if page.is_thing]

    def of(self, *kinds: str) -> list[Visited]:
        found = [page for page in self if page.kind in kinds]
        assert found, f"no {kinds} in the tree"
        return found


def walk(root: str, http: httpx.Client, before: Walk | None = None) -> Walk:
    """``before``: an earlier walk, from which byte-identical resources are taken."""
    found = Walk(root)
    pending = [root]
    with _without_garbage():
        while pending:
            url = pending.pop()
            if url in found.pages:
                continue
            response = _answer(http, url)
            assert response.status_code == 200, f"{url}: {response.status_code} {response.text[:300]}"
            known = before and before.pages.get(url)
            if known and known.says(response):
                page = known
            else:
                triples = _triples(url, response)
                targets = _targets(triples, response, root)
                page = Visited(url, response, _kind(url, triples), targets)
            found.pages[url] = page
            pending += [each for each in page.targets if each not in found.pages]
    return found


@contextlib.contextmanager
def _without_garbage() -> Iterator[None]:
    """Suspend garbage collection while millions of objects are created, and exclude them from later collections."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
    gc.collect()
    gc.freeze()


def _answer(http: httpx.Client, url: str) -> httpx.Response:
    """An idle connection may close at the moment of reuse: the request is then repeated once."""
    try:
        return http.get(url)
    except httpx.RemoteProtocolError:  # RFC 9112, 9.3.1
        return http.get(url)


def _triples(url: str, response: httpx.Response) -> list[pyoxigraph.Triple]:
    """Return the triples of a Turtle document, none of any other."""
    if not response.headers["content-type"].startswith(TURTLE):
        return []
    return triples_of(response.content, url)


def _targets(triples: list[pyoxigraph.Triple], response: httpx.Response, root: str) -> set[str]:
    named = {term.value for triple in triples for term in triple if isinstance(term, pyoxigraph.NamedNode)}
    named |= set(links(response, "related")) | set(links(response, "linkset"))
    if response.headers["content-type"].startswith("application/linkset+json"):
        (context,) = json.loads(response.content)["linkset"]
        named |= {target["href"] for target in context.get("related", ())}
    return {url.partition("#")[0] for url in named if url.startswith(root) and _is_followed(url)}


def _is_followed(url: str) -> bool:
    """Return False for histories, which always differ, and views of them; those of one robot stand for all."""
    return "/ur5/" in url or not ("?" in url or url.endswith("/history"))


def _kind(url: str, triples: list[pyoxigraph.Triple]) -> str:
    here, a = pyoxigraph.NamedNode(url), pyoxigraph.NamedNode(str(RDF.type))
    types = {str(triple.object.value) for triple in triples if triple.subject == here and triple.predicate == a}  # type: ignore[union-attr]
    return next((kind for kind, known in {**_THINGS, **_OTHERS}.items() if str(known) in types), "document")
