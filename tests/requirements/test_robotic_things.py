"""R0.1 and R0.3 to R0.11 of the paper, each on every resource of the tree."""

import socket
from collections import Counter
from urllib.parse import urlsplit

import httpx
import pytest
from rdflib import RDF, URIRef

from browser import HTTP, HYBRIT, LDP, LF, RDFS, SH, links
from walk import WALKED, Visited, Walk

pytestmark = pytest.mark.virtual
ROBOTS = WALKED


def _raw(root: str, request: bytes) -> bytes:
    parts = urlsplit(root)
    with socket.create_connection((parts.hostname, parts.port), timeout=10) as connection:
        connection.sendall(request)
        return connection.recv(65536)


_SERVICE = URIRef("http://www.w3.org/ns/sparql-service-description#Service")


def _writes(tree: Walk, page: Visited) -> set[str]:
    """Return the methods that change something; those of subscriptions are listed separately."""
    if page.kind == "action":
        bindings = page.graph.objects(page.iri, HYBRIT.binding)
        return {str(page.graph.value(each, HTTP.mthd)).rpartition("#")[2] for each in bindings}
    if any((page.iri, RDF.type, each) in page.graph for each in (LF.ControlLease, LF.OccupancyMap)):
        return {"PUT", "DELETE"}
    if page.kind == "property":
        settable = _takes_body(page) or (page.iri, RDF.type, LF.Annotations) in page.graph
        if any((page.iri, RDF.type, each) in page.graph for each in (LF.TargetPosition, LF.ComponentProperty)):
            return {"PUT"} if settable else set()  # a request to the robot, and no setting of the gateway
        removable = any((page.iri, RDF.type, each) in page.graph for each in (LF.Annotations, LF.Placement, LF.Tags))
        return {"PUT", "PATCH", *(["DELETE"] if removable else [])} if settable else set()
    if page.kind in ("invocation", "subscription", "robot"):  # of a robot once it is offline
        return {"DELETE"}
    lists = any((thing, HYBRIT.subscriptions, page.iri) in tree.pages[str(thing)].graph for thing in _about(page))
    takes = (
        LF.objects,
        LF.rules,
        LF.missions,
        LF.queue,
        LF.schedules,
        LF.query,
        LF.savedPoses,
        LF.notes,
        LF.boards,
        LF.stopLatches,
    )
    members = any((thing, each, page.iri) in tree.pages[str(thing)].graph for thing in _about(page) for each in takes)
    return {"POST"} if lists or members else set()


def _takes_body(page: Visited) -> bool:
    return (page.iri, HYBRIT.consumes, None) in page.graph


def _demands_body(page: Visited) -> bool:
    """Return True if the shape of its input has what must not be left out."""
    shape = page.graph.value(page.iri, HYBRIT.consumes)
    parts = page.graph.objects(shape, SH.property) if shape is not None else ()
    return any(int(str(page.graph.value(each, SH.minCount) or 0)) > 0 for each in parts)


def _about(page: Visited) -> list[URIRef]:
    """Return the thing that a container belongs to, or the resource that answers queries, as it states."""
    if page.kind != "container" and (page.iri, RDF.type, _SERVICE) not in page.graph:
        return []
    return [URIRef(str(iri)) for iri in page.graph.objects(page.iri, RDFS.seeAlso)]


def test_r0_1_server_is_http_1_1(tree: Walk) -> None:
    """R0.1: HTTP/1.1, which demands a valid Host header: none or a URL in it is a 400."""
    assert {page.response.http_version for page in tree} == {"HTTP/1.1"}
    assert _raw(tree.root, b"GET / HTTP/1.1\r\n\r\n").startswith(b"HTTP/1.1 400")
    assert _raw(tree.root, b"GET / HTTP/1.1\r\nHost: http://example.org\r\n\r\n").startswith(b"HTTP/1.1 400")
    assert _raw(tree.root, b"GET / HTTP/1.1\r\nHost: example.org\r\n\r\n").startswith(b"HTTP/1.1 421")


def test_r0_3_every_thing_and_sub_resource_has_a_uri(tree: Walk) -> None:
    """R0.3: whatever a description refers to below the root answers under its own URI."""
    for thing in tree.things():
        named = [
            o for p in (HYBRIT.property, HYBRIT.action, HYBRIT.subscriptions) for o in thing.graph.objects(thing.iri, p)
        ]
        assert named, thing.url
        assert all(str(iri) in tree.pages for iri in named), thing.url


def test_r0_4_root_answers_get(tree: Walk, http: httpx.Client) -> None:
    """R0.4: GET on the root."""
    assert http.get(tree.root).status_code == 200


def test_r0_5_get_everywhere_and_writes_where_they_mean_something(tree: Walk, http: httpx.Client) -> None:
    """R0.5: actions, settings, leases and containers of subscriptions accept what they advertise; elsewhere it is 405.

    Methods whose empty request would have an effect are skipped. The first three resources of each type get every
    method, the others one each in turn.
    """
    methods = ("POST", "PUT", "DELETE", "PATCH")
    seen = Counter[frozenset[object]]()
    for index, page in enumerate(tree):
        writes, types = _writes(tree, page), frozenset(page.graph.objects(page.iri, RDF.type))
        seen[types] += 1
        for method in methods if seen[types] <= 3 else methods[index % 4 : index % 4 + 1]:
            if method not in writes:
                answer = http.request(method, page.url, content=b"", headers={"content-type": "text/turtle"})
                assert answer.status_code == 405, f"{method} {page.url}: {answer.text[:200]}"
                assert "GET" in answer.headers["allow"], page.url
            elif method != "DELETE" and (_demands_body(page) or page.kind == "container"):
                answer = http.request(method, page.url, content=b"", headers={"content-type": "text/turtle"})
                assert answer.status_code == (415 if method == "PATCH" else 422), f"{method} {page.url}: {answer.text}"


def test_r0_6_generic_status_codes(tree: Walk, http: httpx.Client) -> None:
    """R0.6: 200 for existing resources, 400 for unparsable requests (500 is tested with the endpoint)."""
    assert all(page.response.status_code == 200 for page in tree)
    for action in [page for page in tree.of("action") if _takes_body(page)][:20]:
        if "POST" not in _writes(tree, action):
            continue
        answer = http.post(action.url, content=b"<> <p> .", headers={"content-type": "text/turtle"})
        assert answer.status_code == 400
        assert {"line", "column"} <= answer.json().keys()


def test_r0_9_link_header_names_sub_resources(tree: Walk) -> None:
    """R0.9: rel="related" for each associated sub-resource, in the header or in the link set that it names."""
    for thing in tree.things():
        header = thing.response.headers["link"]
        assert len(header) < 4096, thing.url
        (linkset,) = links(thing.response, "linkset")
        complete = tree.pages[linkset].response.json()["linkset"][0]["related"]
        related = {entry["href"] for entry in complete}
        assert set(links(thing.response, "related")) <= related
        for predicate in (HYBRIT.property, HYBRIT.action, HYBRIT.subscriptions):
            assert {str(o) for o in thing.graph.objects(thing.iri, predicate)} <= related, thing.url


def test_r0_9_link_header_is_complete_on_small_things(tree: Walk) -> None:
    """R0.9: a joint, link or property names every sub-resource of its own in the header itself."""
    for page in tree.of("joint", "link", "property"):
        related = set(links(page.response, "related"))
        for predicate in (HYBRIT.property, HYBRIT.action, HYBRIT.subscriptions):
            assert {str(o) for o in page.graph.objects(page.iri, predicate)} <= related, page.url


def test_r0_10_options_and_allow_on_every_resource(tree: Walk, http: httpx.Client) -> None:
    """R0.10: OPTIONS lists exactly the possible methods and accepted bodies."""
    for page in tree:
        answer = http.options(page.url)
        assert answer.status_code == 204
        allow = {method.strip() for method in answer.headers["allow"].split(",")}
        assert allow == {"GET", "HEAD", "OPTIONS"} | _writes(tree, page)
        takes = _takes_body(page) or page.kind != "action"
        assert ("accept-post" in answer.headers) == (takes and "POST" in allow)
        assert ("accept-put" in answer.headers) == (takes and "PUT" in allow)
        assert ("accept-patch" in answer.headers) == ("PATCH" in allow)


def test_r0_11_etag_on_every_representation_and_head(tree: Walk, http: httpx.Client) -> None:
    """R0.11: a strong entity tag on every GET and HEAD; HEAD has the headers of GET and no body.

    The list of all things is streamed: its tag precedes its bytes, and is therefore weak.
    """
    for page in tree:
        tag = page.response.headers["etag"]
        assert (tag.removeprefix("W/") if page.url.endswith("/things") else tag).startswith('"'), page.url
    for page in [*tree][::3]:
        head = http.head(page.url)
        assert head.status_code == 200
        assert head.content == b""
        assert head.headers["etag"].startswith(('"', 'W/"'))
        assert head.headers["content-type"] == page.response.headers["content-type"]


def test_r0_11_unchanged_resources_answer_304(tree: Walk, http: httpx.Client) -> None:
    """R0.11: with the current entity tag a constant resource answers 304, without a body."""
    for page in tree.of("blueprint", "action", "container")[::4]:
        # Fetched again: invocations of other tests may have joined a container since the walk.
        answer = http.get(page.url, headers={"if-none-match": http.get(page.url).headers["etag"]})
        assert answer.status_code == 304, page.url
        assert answer.content == b""


def test_ldp_types_in_link_header(tree: Walk) -> None:
    """LDP: rel="type" names ldp:Resource, and the container type of containers; actions are neither."""
    for page in tree:
        types = set(links(page.response, "type"))
        if page.kind == "action":
            assert not types, page.url
            continue
        assert str(LDP.Resource) in types, page.url
        is_container = (page.iri, None, LDP.BasicContainer) in page.graph
        assert (str(LDP.BasicContainer) in types) == is_container, page.url
