"""The whole tree from the root by links only: Link headers, link sets and IRIs in representations."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field

import httpx
import rdflib
from browser import HYBRIT, LDP, LF, TURTLE, links
from rdflib import RDF, URIRef

_THINGS = {"fleet": LF.Fleet, "robot": LF.Robot, "joint": LF.Joint, "link": rdflib.Namespace("http://ros.org/#").Link}


@dataclass
class Visited:
    """One resource of the tree with what was served for it."""

    url: str
    response: httpx.Response
    graph: rdflib.Graph
    kind: str

    @property
    def iri(self) -> URIRef:
        return URIRef(self.url)

    @property
    def is_thing(self) -> bool:
        return self.kind in _THINGS


@dataclass
class Walk:
    """Every resource that can be reached, in the order in which it was found."""

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


def walk(root: str, http: httpx.Client) -> Walk:
    found = Walk(root)
    pending = [root]
    while pending:
        url = pending.pop()
        if url in found.pages:
            continue
        response = http.get(url)
        assert response.status_code == 200, f"{url}: {response.status_code} {response.text[:300]}"
        graph = rdflib.Graph()
        if response.headers["content-type"].startswith(TURTLE):
            graph.parse(data=response.text, format="turtle", publicID=url)
        found.pages[url] = Visited(url, response, graph, _kind(url, graph, response))
        pending += [target for target in _targets(graph, response, root) if target not in found.pages]
    return found


def _targets(graph: rdflib.Graph, response: httpx.Response, root: str) -> set[str]:
    named = {str(term) for triple in graph for term in triple if isinstance(term, URIRef)}
    named |= set(links(response, "related")) | set(links(response, "linkset"))
    if response.headers["content-type"].startswith("application/linkset+json"):
        (context,) = json.loads(response.content)["linkset"]
        named |= {target["href"] for target in context.get("related", ())}
    return {url.partition("#")[0] for url in named if url.startswith(root)}


def _kind(url: str, graph: rdflib.Graph, response: httpx.Response) -> str:
    types = set(graph.objects(URIRef(url), RDF.type))
    for kind, known in _THINGS.items():
        if known in types:
            return kind
    for kind, known in (
        ("property", HYBRIT.Property),
        ("action", HYBRIT.Action),
        ("blueprint", LF.Blueprint),
        ("invocation", LF.Invocation),
        ("subscription", HYBRIT.Subscription),
        ("container", LDP.Container),
    ):
        if known in types:
            return kind
    return "document"
