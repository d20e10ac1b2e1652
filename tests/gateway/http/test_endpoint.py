"""HTTP of every resource in detail, tested with hostile and pedantic clients."""

import asyncio
import json
import logging
import socket
from types import SimpleNamespace
from typing import cast
from urllib.parse import urlsplit

import httpx
import numpy as np
import pytest
import rdflib
from pyoxigraph import NamedNode
from rdflib import RDF, URIRef

from browser import HYBRIT, LF, Browser
from linked_fleet_base.errors import NotAcceptable
from linked_fleet_gateway.app.application import create_app
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.http.answers import ResponseCache
from linked_fleet_gateway.http.endpoint import Endpoint
from linked_fleet_gateway.http.representation import Representations
from linked_fleet_gateway.http.request import Services
from linked_fleet_gateway.http.scheduling import StopPriority
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import RDF_TYPES
from shared_fixtures import RunningFleet

pytestmark = pytest.mark.virtual

_TURTLE = {"content-type": "text/turtle"}
_VOM = "http://vocab.arvida.de/2015/06/vom/vocab#"
_MATHS = "http://vocab.arvida.de/2015/06/maths/vocab#"
_PREFIXES = f"""@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix maths: <{_MATHS}> .
@prefix vom: <{_VOM}> .
@prefix unit: <http://qudt.org/vocab/unit/> .
"""
_ZERO = _PREFIXES + "<> vom:numericalValue 0 ; vom:unit maths:Degree ."
_JSON_LD = {"@context": {"vom": _VOM, "maths": _MATHS}, "vom:unit": {"@id": "maths:Degree"}, "vom:numericalValue": 0.5}


@pytest.fixture(scope="module")
def action(browser: Browser) -> str:
    """Return an action that no other test uses."""
    return _rotate(browser, "head_pan")


def _rotate(browser: Browser, joint: str) -> str:
    """Return the action of one of Baxter's joints that brings it to a position."""
    offered = browser.part("baxter", joint).graph.objects(None, HYBRIT.action)
    (found,) = (page.url for page in map(browser.page, map(str, offered)) if LF.Rotate in page.types)
    return found


def _put(browser: Browser, url: str, body: str | bytes, **headers: str) -> httpx.Response:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return browser.http.put(url, content=body, headers=_TURTLE | named)


def _moved(browser: Browser, action: str) -> str:
    """Return a fingerprint of the list of invocations."""
    return browser.page(str(browser.page(action).one(LF.invocations))).response.text


def _raw(root: str, request: str, fields: str = "", body: bytes = b"") -> list[bytes]:
    """Send ``request`` unchanged, including Host, and read to the end; return one item per response."""
    parts = urlsplit(root)
    host = "" if "Host:" in fields else f"Host: {parts.netloc}\r\n"
    with socket.create_connection((parts.hostname, parts.port), timeout=30) as connection:
        connection.sendall(f"{request}\r\n{host}{fields}\r\n".encode() + body)
        connection.shutdown(socket.SHUT_WR)
        received = b"".join(iter(lambda: connection.recv(65536), b""))
    return [b"HTTP/1.1 " + answer for answer in received.split(b"HTTP/1.1 ")[1:]]


def _status(answer: bytes) -> int:
    return int(answer.split()[1])


# -- requests that are no everyday's --------------------------------------------------------------------------------


def test_request_targets(browser: Browser) -> None:
    """RFC 9112, 3.2: `*` is for OPTIONS, and an absolute URL overrides Host."""
    root, netloc = browser.root, urlsplit(browser.root).netloc
    (answer,) = _raw(root, "OPTIONS * HTTP/1.1", "Connection: close\r\n")
    assert _status(answer) == 204
    assert b"allow: GET, HEAD, OPTIONS, POST, PUT" in answer
    for request, host, status in (
        ("GET * HTTP/1.1", "", 400),
        ("CONNECT example.org:80 HTTP/1.1", "", 400),
        (f"GET http://{netloc} HTTP/1.1", "", 200),
        (f"GET http://{netloc}/baxter/ HTTP/1.1", "Host: example.org\r\n", 200),
        ("GET http://example.org/ HTTP/1.1", "", 421),
    ):
        (answer,) = _raw(root, request, host + "Connection: close\r\n")
        assert _status(answer) == status, request


@pytest.mark.parametrize("protocol", ["websocket", "callback", "h2c", "TLS/1.0", "rosbridge/2, h2c"])
@pytest.mark.parametrize("chunked", [False, True])
def test_ignored_upgrade_loses_nothing(browser: Browser, action: str, protocol: str, chunked: bool) -> None:
    """An Upgrade that is not accepted changes nothing: the body is read, the next request answered (uvicorn 2722).

    A PUT accepts no upgrade, and a GET no unknown one.
    """
    broken = b"<> <urn:p> ; broken"
    length = "Transfer-Encoding: chunked" if chunked else f"Content-Length: {len(broken)}"
    sent = b"%x\r\n%s\r\n0\r\n\r\n" % (len(broken), broken) if chunked else broken
    netloc, path = urlsplit(browser.root).netloc, urlsplit(action).path
    follower = f"GET / HTTP/1.1\r\nHost: {netloc}\r\nUpgrade: h2c\r\nConnection: Upgrade, close\r\n\r\n".encode()
    fields = f"Upgrade: {protocol}\r\nConnection: Upgrade\r\nContent-Type: text/turtle\r\n{length}\r\n"
    first, second = _raw(browser.root, f"PUT {path} HTTP/1.1", fields, sent + follower)
    assert (_status(first), b'"line": 1' in first) == (400, True)
    assert (_status(second), b"content-type: text/turtle" in second) == (200, True)


def test_ignored_upgrade_is_no_news(fleet: RunningFleet) -> None:
    """An Upgrade that is not accepted is not logged."""
    (answer,) = _raw(fleet.root, "GET / HTTP/1.1", "Upgrade: rosbridge/2\r\nConnection: Upgrade, close\r\n")
    assert (_status(answer), b"content-type: text/turtle" in answer) == (200, True)
    assert "Unsupported upgrade" not in fleet.gateway.output
    assert "No supported WebSocket" not in fleet.gateway.output


def test_spellings_of_a_path(browser: Browser) -> None:
    """A percent-encoded letter is that letter; an encoded slash separates nothing; an extra slash is redirected."""
    root, get = browser.root, browser.http.get
    assert get(root + "%62axter/").status_code == 200
    for path in ("baxter%2Fhead_pan", "baxter/head_pan//", "baxter/%2e%2e/", "baxter/%ff", "baxter/%zz", "a" * 20_000):
        answer = get(root + path)
        assert answer.status_code == 404, path[:80]
        assert len(answer.content) < 2000
    for path in (
        "baxter/head_pan",
        "vocabulary",
        "baxter/linkset",
        "world/objects",
        "query",
        "actions/stopAll",
        "rules",
    ):
        answer = get(f"{root}{path}/?a=b")
        assert (answer.status_code, answer.headers["location"]) == (308, f"{root}{path}?a=b")


def test_head_is_get_without_its_body(browser: Browser, action: str) -> None:
    """RFC 9110, 9.3.2: the same status and fields, including Content-Length, for existing resources and errors."""
    own = {"date", "x-request-id"}  # they differ by time and request
    for url, headers in (
        (action, {}),
        (action, {"accept": "text/html"}),
        (browser.root + "vocabulary", {"accept": "application/rdf+xml"}),
        (browser.root + "baxter", {}),
        (browser.root + "nobody/", {"accept": "text/turtle"}),
        (browser.root, {"accept": "image/png"}),
        (browser.root, {"host": "example.org"}),
        (action, {"if-none-match": "*"}),
        (action, {"if-match": '"other"'}),
    ):
        get, head = (browser.http.request(method, url, headers=headers) for method in ("GET", "HEAD"))
        assert head.content == b""
        assert head.status_code == get.status_code, url
        ours = {name: value for name, value in get.headers.multi_items() if name not in own}
        assert {n: v for n, v in head.headers.multi_items() if n not in own} == ours, (url, headers)


def test_every_refusal_varies_with_accept_and_is_not_stored(browser: Browser, action: str) -> None:
    """Problems are negotiated, in their language too, so caches must know; no field is repeated."""
    for answer in (
        browser.http.get(browser.root, headers={"host": "example.org"}),
        browser.http.get(browser.root, headers={"accept": "image/png"}),
        browser.http.get(browser.root + "nobody/"),
        browser.http.delete(action),
        browser.http.put(action, content=b"x"),
    ):
        early = answer.status_code == 421  # its sentence is English: nobody knows the pages of another authority
        varies = "Accept" if early else "Accept, Accept-Language, Cookie"
        assert answer.headers.get_list("vary") == [varies], answer.status_code
        assert answer.headers["cache-control"] == "no-store"
        assert answer.headers["content-type"] == "application/problem+json"


# -- negotiation and conditions -------------------------------------------------------------------------------------


def test_profile_of_json_ld_excludes_nothing(browser: Browser) -> None:
    """A profile is a preference (RFC 6906): a client that names one gets JSON-LD."""
    accept = 'application/ld+json;profile="http://www.w3.org/ns/json-ld#compacted"'
    answer = browser.http.get(browser.root, headers={"accept": accept})
    assert answer.headers["content-type"] == "application/ld+json"


def test_writes_heed_if_none_match(browser: Browser, action: str) -> None:
    """RFC 9110, 13.1.2: for an unsafe method a match is 412; and If-Match applies to reads as well."""
    before = _moved(browser, action)
    tag = browser.http.get(action, headers={"accept": "text/html"}).headers["etag"]
    assert _put(browser, action, _ZERO, if_none_match="*").status_code == 412
    assert _put(browser, action, _ZERO, if_none_match=f'"other", {tag}').status_code == 412
    assert browser.http.get(action, headers={"if-match": '"other"'}).status_code == 412
    assert browser.http.get(action, headers={"if-match": tag}).status_code == 200
    assert _moved(browser, action) == before


def test_preconditions_of_a_read_that_is_refused_anyhow_are_ignored(browser: Browser, action: str) -> None:
    """RFC 9110, 13.2.1."""
    other = {"if-match": '"other"'}
    assert browser.http.get(action, headers=other | {"accept": "image/png"}).status_code == 406
    assert browser.http.get(action + "?as=nothing", headers=other).status_code == 406


def test_unacceptable_answer_moves_nothing(browser: Browser, action: str) -> None:
    """A request for the invocation in an unsupported type gets 406 before the robot moves, not after."""
    before = _moved(browser, action)
    answer = _put(browser, action, _ZERO, prefer="return=representation", accept="image/png")
    assert answer.status_code == 406
    assert _moved(browser, action) == before


def test_frame_is_decodable_by_its_own_description(browser: Browser) -> None:
    """D5: numpy and the robot's layout description suffice to read the binary joint state."""
    robot = browser.robot("ur5")
    state = browser.page(str(robot.one(LF.jointState)))
    answer = browser.http.get(state.url, headers={"accept": "application/vnd.linked-fleet.frame"})
    assert answer.headers["content-type"] == "application/vnd.linked-fleet.frame"
    fields = list(state.graph.items(state.graph.value(state.iri, LF.frameLayout)))

    def said(field: object, predicate: URIRef) -> str:
        return str(state.graph.value(field, predicate))

    layout = {said(field, LF.fieldName): field for field in fields}
    names = {"float64": "<f8", "uint64": "<u8", "uint16": "<u2", "int64": "<i8", "char2": "S2"}
    values = {
        name: np.frombuffer(
            answer.content,
            dtype=names[said(field, LF.fieldType)],
            offset=int(said(field, LF.byteOffset)),
            count=int(said(field, LF.valueCount)),
        )
        for name, field in layout.items()
    }
    positions = [float(str(o)) for o in state.graph.objects(None, LF.position)]
    assert sorted(values["positions"]) == pytest.approx(sorted(positions), abs=1e-3)


# -- bodies ---------------------------------------------------------------------------------------------------------


def test_content_that_is_not_the_whole_plain_body(browser: Browser, action: str) -> None:
    """A coding is 415 with Accept-Encoding, a range 400, and contradictory types 400."""
    coded = _put(browser, action, _ZERO, content_encoding="gzip")
    assert (coded.status_code, coded.headers["accept-encoding"]) == (415, "identity")
    assert _put(browser, action, _ZERO, content_range="bytes 0-9/10").status_code == 400
    twice = [("content-type", "text/turtle"), ("content-type", "application/ld+json")]
    assert browser.http.put(action, content=_ZERO, headers=twice).status_code == 400
    untyped = browser.http.put(action, content=_ZERO.encode())
    assert (untyped.status_code, "text/turtle" in untyped.headers["accept"]) == (415, True)
    assert _put(browser, action, _ZERO, content_type="text/turtle; charset=latin-1").status_code == 415
    assert browser.http.put(action, content=iter([b"#" * 1000] * 300), headers=_TURTLE).status_code == 413


@pytest.mark.parametrize(
    "body",
    [
        _JSON_LD,
        [_JSON_LD],
        {"@context": _JSON_LD["@context"], "@graph": [{k: v for k, v in _JSON_LD.items() if k[0] != "@"}]},
        {**_JSON_LD, "@context": "/context"},
    ],
    ids=["object", "array", "graph", "our context"],
)
def test_json_ld_in_its_many_forms(browser: Browser, action: str, body: object) -> None:
    """One quantity, in any form of JSON-LD."""
    answer = _put(browser, action, json.dumps(body), content_type="application/ld+json")
    assert answer.status_code == 204, answer.text


@pytest.mark.parametrize(
    ("media_type", "body"),
    [
        ("application/ld+json", json.dumps(_JSON_LD | {"@context": "http://127.0.0.1:9/remote"})),
        ("application/ld+json", json.dumps(_JSON_LD | {"@context": {"@import": "http://127.0.0.1:9/remote"}})),
        ("application/ld+json", "[" * 60_000),
        ("application/ld+json", '{"@context": {"a": "b", "b": "a"}, "a": 1}'),
        ("text/turtle", f"<> <urn:p> '{'x' * 60_000}' ."),
        ("application/rdf+xml", '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><x xmlns="urn:">&b;</x>'),
        ("application/rdf+xml", "<a>" * 20_000),
        ("application/n-triples", "\x00"),
    ],
)
def test_bombs_are_malformed(browser: Browser, action: str, media_type: str, body: str) -> None:
    """Depth, length, entities and remote contexts are refused as 400 with the reason."""
    answer = _put(browser, action, body, content_type=media_type)
    assert (answer.status_code, bool(answer.json()["detail"])) == (400, True), answer.text[:300]


@pytest.mark.parametrize("body", ["(" * 60_000, "[<urn:p> " * 5000 + "1" + "]" * 5000 + "."])
def test_bombs_of_triples_are_too_large(browser: Browser, action: str, body: str) -> None:
    answer = _put(browser, action, "<> <urn:p> " + body)
    assert (answer.status_code, bool(answer.json()["detail"])) == (413, True), answer.text[:300]


_INTEGERS = "integer int long short byte nonNegativeInteger nonPositiveInteger unsignedLong unsignedInt unsignedShort"


@pytest.mark.parametrize("datatype", f"float double decimal {_INTEGERS} unsignedByte".split())
def test_every_numeric_type_is_taken(browser: Browser, action: str, datatype: str) -> None:
    """Any numeric literal type is accepted; terms of foreign vocabularies about the input are ignored."""
    extra = '<> a maths:Scalar ; <urn:p> "NaN"^^xsd:float , "<b>"^^rdf:HTML .'
    body = _PREFIXES + f'<> vom:numericalValue "0"^^xsd:{datatype} ; vom:unit maths:Degree . {extra}'
    assert _put(browser, action, body).status_code == 204


_DEGREE = "maths:Degree"


@pytest.mark.parametrize(
    ("value", "unit", "named"),
    [
        ('"1_0"^^xsd:float', _DEGREE, "1_0"),
        ('"٣"^^xsd:integer', _DEGREE, "٣"),
        ('"1e1"^^xsd:decimal', _DEGREE, "1e1"),
        ('"0.5"^^xsd:integer', _DEGREE, "0.5"),
        ('"300"^^xsd:byte', _DEGREE, "numericalValue"),
        ('"0"^^xsd:boolean', _DEGREE, "numericalValue"),
        ('"NaN"^^xsd:float', "vom:Degree", "NaN"),
        ('"INF"^^xsd:double', "vom:Degree", "INF"),
        ('"abc"^^xsd:float', "vom:Degree", "abc"),
        ('"43.6"', "vom:Degree", "numericalValue"),
        ("99", "vom:Degree", "59.988681"),
        ("9" * 400, "vom:Degree", "59.988681"),
        ("1.2", "maths:Radian", "1.047"),
        ("1, 2", "vom:Degree", "1 value at most"),
        (", ".join(map(str, range(900))), _DEGREE, " more"),
        (", ".join(f'"<a>{n}"^^rdf:HTML' for n in range(900)), _DEGREE, " more"),
        ("1", "unit:M", "unit"),
        ("1", "vom:Degree, maths:Radian", "unit"),
    ],
)
def test_quantities_that_are_none(browser: Browser, value: str, unit: str, named: str) -> None:
    """Ill-typed, doubled, extreme and foreign values get 422 with what was wrong; the joint is not commanded."""
    action = _rotate(browser, "right_s1")
    before = _moved(browser, action)
    answer = _put(browser, action, _PREFIXES + f"<> vom:numericalValue {value} ; vom:unit {unit} .")
    assert (answer.status_code, named in answer.json()["detail"]) == (422, True), answer.text[:500]
    assert answer.headers["content-type"] == "application/problem+json"
    assert _moved(browser, action) == before


def test_limits_belong_to_the_range(browser: Browser) -> None:
    """The exact limits of the shape, in degree and radian, are admitted; a millionth more is not."""
    url = _rotate(browser, "left_e1")
    page = browser.page(url)
    graph = page.graph
    branches = list(graph.items(graph.value(graph.value(page.iri, HYBRIT.consumes), rdflib.SH["or"])))
    for unit in (f"{_MATHS}Degree", f"{_MATHS}Radian"):
        (top,) = (
            graph.value(limit, rdflib.SH.maxInclusive)
            for limit in graph.subjects(rdflib.SH.maxInclusive)
            if unit in _units_beside(graph, limit, branches)
        )
        body = _PREFIXES + f"<> vom:unit <{unit}> ; vom:numericalValue {{}} ."
        assert _put(browser, url, body.format(top)).status_code == 204
        assert _put(browser, url, body.format(f"{float(top) + 2e-6:.6f}")).status_code == 422


def _units_beside(graph: rdflib.Graph, limit: object, branches: list[object]) -> set[str]:
    """Return the units to which a limit applies, if it is one of ``branches``."""
    (branch,) = graph.subjects(rdflib.SH.property, limit)
    if branch not in branches:
        return set()
    heads = [graph.value(each, rdflib.SH["in"]) for each in graph.objects(branch, rdflib.SH.property)]
    return {str(item) for head in heads if head is not None for item in graph.items(head)}


# -- without a fleet ------------------------------------------------------------------------------------------------


def test_syntax_that_cannot_say_a_graph_gives_way() -> None:
    """RDF/XML cannot write <urn:1> as a predicate: the next acceptable type is used, else 406."""

    def describe(graph: Graph) -> None:
        graph.add(NamedNode("urn:s"), NamedNode("urn:1"), NamedNode("urn:o"))

    def ask(accept: str) -> str:
        return Representations().negotiate(accept, Resource("/", "", describe), "http://127.0.0.1").media_type

    assert ask("application/rdf+xml, text/turtle;q=0.1") == "text/turtle"
    with pytest.raises(NotAcceptable) as refused:
        ask("application/rdf+xml")
    assert "application/rdf+xml" not in refused.value.offered
    assert refused.value.offered == [each for each in RDF_TYPES if each != "application/rdf+xml"]


def test_r0_6_unforeseen_errors(caplog: pytest.LogCaptureFixture) -> None:
    """R0.6: an unforeseen error is a 500 problem that reveals nothing of the code; the log has everything."""
    app = create_app(GatewaySettings())
    app.endpoint = Endpoint()
    # No request was foreseen without a fleet.
    app.services = cast(
        Services,
        SimpleNamespace(
            identities=None,
            live=None,
            stop_priority=StopPriority(),
            response_cache=ResponseCache(),
            representations=Representations(),
        ),
    )

    async def ask(accept: str) -> httpx.Response:
        transport = httpx.ASGITransport(app=app)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client:
            return await client.get("/", headers={"accept": accept})

    with caplog.at_level(logging.ERROR):
        answer = asyncio.run(ask("*/*"))
        in_turtle = asyncio.run(ask("text/turtle"))
    assert (answer.status_code, answer.headers["content-type"]) == (500, "application/problem+json")
    assert answer.json()["type"].endswith("#internal")
    assert "Traceback" not in answer.text
    assert "AttributeError" not in answer.text
    graph = rdflib.Graph().parse(data=in_turtle.text, format="turtle")
    assert (None, RDF.type, URIRef(LF.Problem)) in graph
    assert "Traceback" in caplog.text
