"""The query operation of the SPARQL 1.1 Protocol: forms of requests and responses.

The cases are those of the W3C's protocol tests that apply to a read-only service, reworded.
"""

import csv
import io
import re
from collections.abc import Mapping
from html import unescape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import httpx
import pytest
import rdflib
from rdflib import RDF

from browser import Browser
from small_fleet import Place

pytestmark = pytest.mark.virtual
LF = rdflib.Namespace("https://w3id.org/linked-fleet#")
SD = rdflib.Namespace("http://www.w3.org/ns/sparql-service-description#")
VOID = rdflib.Namespace("http://rdfs.org/ns/void#")
ASK, SELECT = "ASK { ?s ?p ?o }", "PREFIX lf: <https://w3id.org/linked-fleet#> SELECT ?robot { ?robot a lf:Robot }"
CONSTRUCT = "CONSTRUCT { ?s a ?c } WHERE { ?s a ?c }"
JSON, XML = "application/sparql-results+json", "application/sparql-results+xml"
QUERY, FORM = "application/sparql-query", "application/x-www-form-urlencoded"
_RESULTS = "{http://www.w3.org/2005/sparql-results#}"


def ask(http: httpx.Client, query: str, **fields: str) -> httpx.Response:
    return http.get("/query", params={"query": query}, headers=fields)


def rows(response: httpx.Response) -> list[dict[str, str]]:
    assert response.status_code == 200, response.text
    return [{name: term["value"] for name, term in row.items()} for row in response.json()["results"]["bindings"]]


@pytest.mark.parametrize(
    ("method", "arguments"),
    [
        ("GET", {"params": {"query": ASK}}),
        ("POST", {"data": {"query": ASK}}),
        ("POST", {"content": ASK, "headers": {"content-type": QUERY}}),
        ("POST", {"content": ASK, "headers": {"content-type": f"{QUERY}; charset=UTF-8"}}),
    ],
)
def test_a_query_is_asked_in_three_ways(http: httpx.Client, method: str, arguments: dict[str, Any]) -> None:
    response = http.request(method, "/query", **arguments)
    assert response.status_code == 200, response.text
    assert response.headers["content-type"] == JSON
    assert response.headers["cache-control"] == "no-store"
    assert response.json()["boolean"] is True


@pytest.mark.parametrize(
    ("query", "accept", "content_type"),
    [
        (SELECT, "*/*", JSON),
        (SELECT, JSON, JSON),
        (SELECT, "application/json", "application/json"),
        (SELECT, XML, XML),
        (SELECT, "text/csv", "text/csv; charset=utf-8"),
        (SELECT, "text/tab-separated-values", "text/tab-separated-values; charset=utf-8"),
        (SELECT, f"{XML};q=0.5, text/csv", "text/csv; charset=utf-8"),
        (SELECT, "text/html", "text/html; charset=utf-8"),
        (ASK, XML, XML),
        (ASK, "text/html", "text/html; charset=utf-8"),
        (CONSTRUCT, "*/*", "text/turtle; charset=utf-8"),
        (CONSTRUCT, "application/ld+json", "application/ld+json"),
        (CONSTRUCT, "application/rdf+xml", "application/rdf+xml"),
        (CONSTRUCT, "application/n-triples", "application/n-triples"),
        (CONSTRUCT, "application/x-jelly-rdf", "application/x-jelly-rdf"),
        (CONSTRUCT, "text/html", "text/html; charset=utf-8"),
        ("DESCRIBE <ur5/>", "text/turtle", "text/turtle; charset=utf-8"),
    ],
)
def test_the_result_is_of_the_type_that_is_accepted(
    http: httpx.Client, query: str, accept: str, content_type: str
) -> None:
    response = ask(http, query, accept=accept)
    assert (response.status_code, response.headers["content-type"]) == (200, content_type), response.text
    assert "accept" in response.headers["vary"].lower()
    assert response.content


def test_all_formats_say_the_same(http: httpx.Client, root: str) -> None:
    robots = {f"{root}panda/", f"{root}ur5/"}
    assert {row["robot"] for row in rows(ask(http, SELECT))} == robots
    found = ElementTree.fromstring(ask(http, SELECT, accept=XML).content)
    assert {str(each.text) for each in found.iter(_RESULTS + "uri")} == robots
    table = list(csv.reader(io.StringIO(ask(http, SELECT, accept="text/csv").text)))
    assert (table[0], {row[0] for row in table[1:]}) == (["robot"], robots)
    lines = ask(http, SELECT, accept="text/tab-separated-values").text.split("\n")
    assert (lines[0], set(lines[1:-1])) == ("?robot", {f"<{each}>" for each in robots})
    page = ask(http, SELECT, accept="text/html").text
    assert all(f'href="{each}"' in page for each in robots)


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        ({"params": {"query": "nonsense"}}, 400),
        ({"params": {"query": "SELECT * { ?s ?p"}}, 400),
        ({"params": {"query": ""}}, 400),
        ({"params": [("query", ASK), ("query", ASK)]}, 400),
        ({"params": {"update": "CLEAR ALL"}}, 400),
        ({"params": {"query": "INSERT DATA { <a:a> <a:b> 1 }"}}, 400),
        ({"params": {"query": "SELECT * { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }"}}, 400),
        ({"params": {"query": "ASK { ?s ?p '\ufffe' SERVICE SILENT ?g { ?s ?p ?o } }"}}, 400),
        ({"method": "POST", "data": {"update": "CLEAR ALL"}}, 400),
        ({"method": "POST", "data": {"query": ASK, "update": "CLEAR ALL"}}, 400),
        ({"method": "POST", "data": {}, "headers": {"content-type": FORM}}, 400),
        ({"method": "POST", "data": {"query": [ASK, ASK]}}, 400),
        ({"method": "POST", "content": b"\xff", "headers": {"content-type": QUERY}}, 400),
        ({"method": "POST", "content": "query=%FF", "headers": {"content-type": FORM}}, 400),
        ({"method": "POST", "content": ASK, "headers": {"content-type": QUERY}, "params": {"query": ASK}}, 400),
        ({"method": "POST", "content": "", "headers": {"content-type": QUERY}}, 400),
        ({"method": "POST", "content": "CLEAR ALL", "headers": {"content-type": "application/sparql-update"}}, 415),
        ({"method": "POST", "content": ASK, "headers": {"content-type": "text/plain"}}, 415),
        ({"method": "POST", "content": ASK}, 415),
        ({"method": "POST", "content": ASK, "headers": {"content-type": f"{QUERY}; charset=utf-16"}}, 415),
        ({"method": "POST", "content": ASK, "headers": {"content-type": QUERY, "content-encoding": "gzip"}}, 415),
        ({"method": "POST", "content": "#" * 70_000, "headers": {"content-type": QUERY}}, 413),
        ({"params": {"query": ASK}, "headers": {"accept": "text/csv"}}, 406),
        ({"params": {"query": SELECT}, "headers": {"accept": "text/turtle"}}, 406),
        ({"params": {"query": CONSTRUCT}, "headers": {"accept": JSON}}, 406),
        ({"params": {"query": SELECT, "as": "nothing"}}, 406),
        ({"method": "PUT", "content": ASK}, 405),
        ({"method": "DELETE"}, 405),
    ],
)
def test_an_invalid_query_is_refused(http: httpx.Client, arguments: Mapping[str, Any], status: int) -> None:
    response = http.request(**({"method": "GET", "url": "/query"} | arguments))
    assert response.status_code == status, (arguments, response.text)
    if "json" in response.headers["content-type"]:
        assert response.json()["status"] == status
        assert response.json()["detail"]
    if status == 415:
        assert QUERY in response.headers.get("accept", QUERY)


def test_a_refusal_says_where_the_query_is_wrong(http: httpx.Client) -> None:
    problem = ask(http, "SELECT *\n{ ?s ?p }").json()
    assert problem["line"] == 2


# -- the dataset ------------------------------------------------------------------------------------------------------

_GRAPHS = "SELECT DISTINCT ?g { GRAPH ?g { ?s ?p ?o } }"
_WORLD = ("world", "world/objects", "world/map")
_ANY = "SELECT DISTINCT ?s { ?s a <https://w3id.org/linked-fleet#Robot> }"


@pytest.mark.parametrize("method", ["GET", "FORM", "POST"])
@pytest.mark.parametrize(
    ("query", "default", "named", "found"),
    [
        (_ANY, [], [], {"ur5/", "panda/"}),
        (_ANY, ["ur5/"], [], {"ur5/"}),
        (_ANY, ["ur5/", "panda/"], [], {"ur5/", "panda/"}),
        (_ANY, [], ["ur5/"], set()),
        (_ANY, ["nobody/"], [], set()),
        (_ANY.replace("{", "FROM <panda/> {"), [], [], {"panda/"}),
        (_ANY.replace("{", "FROM <panda/> {"), ["ur5/"], [], {"ur5/"}),
        (_GRAPHS, [], ["ur5/", "panda/"], {"ur5/", "panda/"}),
        (_GRAPHS, ["ur5/"], [], set()),
        (_GRAPHS.replace("{", "FROM NAMED <panda/> {", 1), [], ["ur5/"], {"ur5/"}),
        (
            _GRAPHS,
            [],
            [],
            {"", "ur5/", "panda/", "vocabulary", "blueprint", "faults", "world", "world/objects", "world/map"},
        ),
    ],
)
def test_the_dataset_of_the_request_goes_before_that_of_the_query(
    http: httpx.Client, root: str, method: str, query: str, default: list[str], named: list[str], found: set[str]
) -> None:
    said = [("default-graph-uri", root + each) for each in default]
    said += [("named-graph-uri", root + each) for each in named]
    if method == "GET":
        response = http.get("/query", params=[("query", query), *said])  # type: ignore[arg-type]
    elif method == "FORM":
        data = {name: [value for key, value in said if key == name] for name, _ in said}
        response = http.post("/query", data={"query": query, **data})
    else:
        response = http.post("/query", content=query, headers={"content-type": QUERY}, params=said)  # type: ignore[arg-type]
    assert {next(iter(row.values())) for row in rows(response)} == {root + each for each in found}


# -- the service itself -----------------------------------------------------------------------------------------------


def test_the_fleet_leads_to_the_service_which_describes_itself(http: httpx.Client, browser: Browser) -> None:
    assert rows(ask(http, SELECT))  # so that triples have been counted
    service = browser.page(str(browser.page(browser.root).one(LF.query)))
    assert SD.Service in service.types
    assert service.one(SD.endpoint) == service.iri
    assert service.one(SD.supportedLanguage) == SD.SPARQL11Query
    assert set(service.graph.objects(None, SD.name)) >= {rdflib.URIRef(browser.root + each) for each in ("ur5/", "")}
    dataset = service.one(SD.defaultDataset)
    union = service.graph.value(rdflib.BNode(dataset), SD.defaultGraph)
    (counted,) = rows(ask(http, "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"))
    assert int(str(service.graph.value(union, VOID.triples))) == int(counted["n"])
    assert "POST" in service.response.headers["allow"]
    examples = [str(each) for each in service.graph.objects(None, rdflib.SH.select)]
    assert len(examples) == 4
    for query in examples:
        response = ask(http, query)
        assert response.status_code == 200, response.text


def test_its_page_asks_without_a_script(http: httpx.Client) -> None:
    page = http.get("/query", headers={"accept": "text/html"})
    assert "form-action 'self'" in page.headers["content-security-policy"]
    assert page.text.count('<form method="get" action="/query">') == 5
    assert '<textarea name="query"' in page.text


def test_the_page_keeps_a_query_that_is_refused(http: httpx.Client) -> None:
    """The page shows the reason beside it, and marks the place in the text; programs get problem details as usual."""
    query = "SELECT ?x {\n  ?x a nonsense\n}"
    page = ask(http, query, accept="text/html")
    assert (page.status_code, page.headers["cache-control"]) == (400, "no-store")
    assert "form-action 'self'" in page.headers["content-security-policy"]
    assert f">\n{query}</textarea>" in page.text and 'data-line="2"' in page.text
    assert "This is not a SPARQL query" in page.text
    problem = ask(http, query, accept="application/json")
    assert (problem.headers["content-type"], problem.json()["line"]) == ("application/problem+json", 2)


def test_its_page_has_columns_as_they_were_selected(http: httpx.Client, root: str) -> None:
    """IRIs are short links, numbers have few digits, and the same rows are available as CSV and JSON."""
    query = """PREFIX ros: <http://ros.org/#> SELECT ?z ?a ?n { VALUES (?z ?a ?n) {
        (<ur5/> ros:Link 0.1234567891) (<https://example.org/some/thing> 'x'@de 'no number') } }"""
    page = ask(http, query, accept="text/html").text
    assert re.findall(r'<th scope="col"><bdi>(\w)</bdi></th>', page) == ["z", "a", "n"]
    assert f'<a href="{root}ur5/"><bdi>ur5/</bdi></a>' in page
    assert "<bdi>ros:Link</bdi>" in page and "<bdi>thing at example.org</bdi>" in page
    assert '<data value="0.1234567891">0.1235</data>' in page
    for name in ("csv", "json"):
        (href,) = re.findall(rf'<a href="([^"]+)" download="results.{name}">', page)
        assert "0.1234567891" in http.get(unescape(href)).text


def test_results_are_text_on_a_page(http: httpx.Client) -> None:
    page = ask(http, "SELECT ?x { VALUES ?x { '<script>x</script>' <javascript:alert(1)> } }", accept="text/html").text
    assert "<script>x" not in page
    assert 'href="javascript:' not in page


def test_a_construct_query_returns_the_served_description(http: httpx.Client, root: str) -> None:
    query = "PREFIX dcterms: <http://purl.org/dc/terms/> CONSTRUCT WHERE { <ur5/> dcterms:hasPart ?part }"
    graph = rdflib.Graph().parse(data=ask(http, query, accept="text/turtle").text, format="turtle")
    robot = rdflib.Graph().parse(data=http.get("/ur5/").text, format="turtle", publicID=f"{root}ur5/")
    assert set(graph) == set(robot.triples((None, rdflib.DCTERMS.hasPart, None)))
    assert (rdflib.URIRef(f"{root}ur5/"), RDF.type, LF.Robot) in robot


def test_a_fleet_without_robots_can_be_queried(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway():
        select = f"SELECT ?fleet WHERE {{ ?fleet a <{LF.Fleet}> }}"
        answer = httpx.get(f"{place.root}query", params={"query": select}, headers={"accept": "text/csv"}, timeout=60)
    assert (answer.status_code, answer.text.split()) == (200, ["fleet", place.root])
