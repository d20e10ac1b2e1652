"""The resources of a server, found by links: breadth first, evenly over kinds, bounded in number."""

from collections import defaultdict, deque
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from urllib.parse import urldefrag

import rdflib
from rdflib import RDF, URIRef
from rdflib.term import Node

from linked_fleet_client.conform.rdf import (
    TURTLE,
    hybrit,
    link_targets,
    linked_iris,
    linkset_targets,
    turtle_graph,
    types,
)
from linked_fleet_client.conform.web import Answer, Web

_PART_OF_TIME = 0.5
_MOST_BYTES = 64 * 2**20
_GONE = (404, 410)
# Predicates that identify things. Blueprints are excluded, because other resources have them too.
_ROLES = ("subscriptions", "property", "action", "blueprint")


@dataclass(frozen=True)
class Page:
    """A resource: its answer to a plain GET, and its graph from that answer or from one with Accept: text/turtle.

    ``fault`` is the reason for having no graph.
    """

    answer: Answer
    graph: rdflib.Graph
    fault: str
    turtle_graph: Answer
    """The answer that contains the graph."""
    asked: str
    """The requested URL, before redirects."""
    found_on: str = ""

    @property
    def url(self) -> str:
        return self.answer.url

    @property
    def node(self) -> URIRef:
        """The subject of the page: its own URL, or the first fragment of it that it describes."""
        own = URIRef(self.url)
        if (own, None, None) in self.graph:
            return own
        fragments = [str(s) for s in self.graph.subjects() if str(s).startswith(f"{self.url}#")]
        return URIRef(min(fragments, default=self.url))


@dataclass
class Walk:
    """All pages found. ``truncation_reason`` says why there may be more."""

    root: Page
    model: rdflib.Namespace
    pages: dict[str, Page] = field(default_factory=dict)
    truncation_reason: str = ""

    def __iter__(self) -> Iterator[Page]:
        return iter(self.pages.values())

    def __len__(self) -> int:
        return len(self.pages)

    def things(self) -> list[Page]:
        """Return the Linked Robotic Things, by type or sub-resources; the root if there are none."""
        return [page for page in self if self._claims(page)] or [self.root]

    def _claims(self, page: Page) -> bool:
        if self.model.RoboticThing in types(page.graph, page.node):
            return True
        return any((page.node, self.model[role], None) in page.graph for role in _ROLES[:3])

    def objects_in_role(self, page: Page, role: str) -> list[Node]:
        """Return the nodes that a page names as its property, action, subscriptions or blueprint."""
        return sorted(page.graph.objects(page.node, self.model[role]), key=str)

    def pages_in_role(self, role: str) -> list[Page]:
        """Return the pages that others name in this role."""
        urls = {plain(node) for page in self for node in self.objects_in_role(page, role)}
        return [page for page in self if page.url in urls]

    def sub_resources(self, page: Page) -> list[tuple[str, Node]]:
        return [(role, node) for role in _ROLES for node in self.objects_in_role(page, role)]

    def typed_nodes(self) -> set[Node]:
        """Return the nodes that any page types as a Robotic Thing."""
        return {node for page in self for node in page.graph.subjects(RDF.type, self.model.RoboticThing)}

    def claimed_pages(self) -> list[Page]:
        """Return the root, the things and their named sub-resources, which must answer."""
        urls = {plain(node) for page in self for _, node in self.sub_resources(page)} | {self.root.url}
        urls.update(plain(node) for node in self.typed_nodes())
        urls.update(url for page in self for url in link_targets(page.answer, "related"))
        return [page for page in self if page.asked in urls or page.url in urls]


async def read(web: Web, url: str, found_on: str = "", in_any_case: bool = False) -> Page:
    """Read one page; request it a second time if it is Turtle only on demand."""
    answer = await web.request("GET", url, in_any_case=in_any_case)
    graph, fault = turtle_graph(answer)
    if fault and answer.successful and answer.media_type != TURTLE:
        on_demand = await web.request("GET", url, {"accept": TURTLE}, in_any_case=in_any_case)
        graph, asked_fault = turtle_graph(on_demand)
        return Page(answer, graph, fault if asked_fault else "", on_demand, url, found_on)
    return Page(answer, graph, fault, answer, url, found_on)


async def walk(web: Web, root: Page, most: int) -> Walk:
    """Find at most ``most`` resources in at most half of the total time; the other half is for trials."""
    found = Walk(root, hybrit(root.graph), {root.url: root})
    queues: defaultdict[Hashable, deque[tuple[str, str]]] = defaultdict(deque)
    seen = {root.url, web.root}
    _enqueue(web, queues, root, seen)
    while turn := [queue for queue in queues.values() if queue]:
        for queue in turn:
            url, found_on = queue.popleft()
            if found.truncation_reason:
                return found
            page = await read(web, url, found_on)
            if page.url in found.pages or await _has_gone(web, page):
                continue
            found.pages[page.url] = page
            _enqueue(web, queues, page, seen)
            found.truncation_reason = _limit(web, len(found), most) if any(queues.values()) else ""
    return found


def _limit(web: Web, size: int, most: int) -> str:
    if size >= most:
        return f"only {most} resources are visited"
    if web.received > _MOST_BYTES:
        return f"only {size} resources were visited, which have {web.received} bytes"
    return f"only {size} resources were visited in time" if web.used_share > _PART_OF_TIME else ""


async def _has_gone(web: Web, page: Page) -> bool:
    """Return True if a resource and the link to it disappeared during the walk, which is no fault."""
    if page.answer.status not in _GONE or not page.found_on:
        return False
    origin = await read(web, page.found_on)
    return page.asked not in {url for url, _ in _links(origin)}


def _enqueue(web: Web, queues: defaultdict[Hashable, deque[tuple[str, str]]], page: Page, seen: set[str]) -> None:
    for url, kind in sorted(_links(page), key=lambda link: link[0]):
        if url not in seen and web.same_origin(url):
            seen.add(url)
            queues[kind].append((url, page.url))


def _links(page: Page) -> list[tuple[str, Hashable]]:
    """Return the URLs that a page links, each with its kind: the types that the page states, otherwise the relation.

    A typed IRI in the graph takes precedence over the same IRI in a Link field.
    """
    links: dict[str, Hashable] = {}
    for node, predicate in linked_iris(page.graph):
        kind = types(page.graph, node) or predicate
        links.setdefault(plain(node), kind)
    for relation in ("related", "linkset"):
        for url in (*link_targets(page.answer, relation), *linkset_targets(page.answer, relation)):
            links.setdefault(url, relation)
    return list(links.items())


def plain(node: Node) -> str:
    return urldefrag(str(node)).url
