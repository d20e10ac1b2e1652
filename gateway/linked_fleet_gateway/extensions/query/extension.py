"""The extension ``query``: SPARQL 1.1 over the live fleet, evaluated in a process of its own.

The endpoint supports the query operation of the SPARQL 1.1 Protocol (W3C Recommendation of 21 March 2013), and no
updates.
"""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urljoin

from starlette.responses import Response

from linked_fleet_base.errors import PROBLEM_JSON, BadRequest, FleetError, NotAcceptable, UnsupportedMediaType
from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.api import (
    Core,
    Extension,
    Mount,
    NavigationEntry,
    Request,
    RequestView,
    Resource,
    body_type,
    choose,
    read_resource,
)
from linked_fleet_gateway.extensions.query.description import (
    FORM,
    PATH,
    QUERY_TYPES,
    Endpoint,
    PostQuery,
    branch,
    endpoint_resource,
)
from linked_fleet_gateway.extensions.query.operations import operations
from linked_fleet_gateway.extensions.query.service import JSON_RESULTS, Queries
from linked_fleet_gateway.extensions.query.sparql_syntax import Dataset, Query, parse_query
from linked_fleet_gateway.faces import HTML
from linked_fleet_gateway.serving import await_preconditions, problem, read_body
from linked_fleet_rdf.serialise import RDF_TYPES
from linked_fleet_rdf.sparql_tokens import MAX_QUERY_BYTES

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.query import page
else:
    page = LazyModule("linked_fleet_gateway.extensions.query.page")


_UPDATE = "application/sparql-update"
_BOOLEANS = (JSON_RESULTS, "application/sparql-results+xml", "application/json", HTML)
_SOLUTIONS = (*_BOOLEANS, "text/csv", "text/tab-separated-values")
_GRAPHS = (*RDF_TYPES, HTML)
_PICKED = {
    "json": JSON_RESULTS, "xml": "application/sparql-results+xml", "csv": "text/csv",
    "tsv": "text/tab-separated-values", "html": HTML, "turtle": "text/turtle", "jsonld": "application/ld+json",
    "ntriples": "application/n-triples", "rdfxml": "application/rdf+xml", "jelly": "application/x-jelly-rdf",
}  # fmt: skip
_MAX_FIELDS = 64
_SHORT = 1024  # characters of a query that is parsed on the event loop
# Results are for the caller, at that instant, and must not run anything in a browser.
_HEADERS = {"vary": "Accept", "cache-control": "no-store", "x-content-type-options": "nosniff"}
_INERT = "sandbox; default-src 'none'"
_COUNTS = "SELECT ?graph (COUNT(*) AS ?triples) { GRAPH ?graph { ?s ?p ?o } } GROUP BY ?graph"


@dataclass(frozen=True)
class _ParsedQuery:
    """A query request: text, dataset, and a replacement for ``Accept``."""

    query: str
    dataset: Dataset
    picked: str | None


async def read_query(request: Request, resource: Resource, endpoint: Endpoint) -> Response:
    """Return the result of a query in the URL; without one, the description of the endpoint."""
    said = _pairs(request.scope["query_string"])
    if any(name in ("query", "update") for name, _ in said):
        return await _answer(request, endpoint, _asked(said, request.base))
    answer = endpoint_resource(endpoint, await _counts(endpoint, request.caller_name))
    await await_preconditions(request, answer)
    return read_resource(request, answer)


async def post_query(request: Request, affords: PostQuery) -> Response:
    """Answer a query in the body, either as plain text or as a form (SPARQL 1.1 Protocol, 2.1.2, 2.1.3)."""
    if (request.field("content-type") or "").partition(";")[0].strip().lower() == _UPDATE:
        raise UnsupportedMediaType(
            "SPARQL updates are not supported; robots are moved by their actions.", offered=QUERY_TYPES
        )
    if body_type(request, QUERY_TYPES) == FORM:
        return await _answer(request, affords.endpoint, _asked(_pairs(await read_body(request, _most())), request.base))
    body = await read_body(request)
    said = _pairs(request.scope["query_string"])
    if any(name in ("query", "update") for name, _ in said):
        raise BadRequest("The query is the body; the URL may only have the dataset.")
    return await _answer(request, affords.endpoint, _asked([("query", _text(body)), *said], request.base))


def _most() -> int:
    return 3 * MAX_QUERY_BYTES  # each byte may be %XX


def _pairs(content: bytes) -> list[tuple[str, str]]:
    try:
        return parse_qsl(content.decode(), keep_blank_values=True, errors="strict", max_num_fields=_MAX_FIELDS)
    except ValueError as error:
        raise BadRequest(f"The parameters are not UTF-8, or there are more than {_MAX_FIELDS}.") from error


def _text(body: bytes) -> str:
    try:
        return body.decode()
    except UnicodeDecodeError as error:
        raise BadRequest("The query is not UTF-8.") from error


def _asked(said: Sequence[tuple[str, str]], base: str) -> _ParsedQuery:
    def all_of(name: str) -> list[str]:
        return [value for key, value in said if key == name]

    def graphs(name: str) -> tuple[str, ...]:
        try:
            return tuple(urljoin(base + PATH, each) for each in all_of(name))
        except ValueError as error:
            raise BadRequest(f"{name} is an IRI.") from error

    queries = all_of("query")
    if all_of("update"):
        raise BadRequest("SPARQL updates are not supported; robots are moved by their actions.")
    if len(queries) != 1:
        raise BadRequest(f"Send one query, not {len(queries)}.")
    dataset = Dataset.from_iris(graphs("default-graph-uri"), graphs("named-graph-uri"))
    return _ParsedQuery(queries[0], dataset, next(iter(all_of("as")), None))


async def _answer(request: Request, endpoint: Endpoint, asked: _ParsedQuery) -> Response:
    """Return the result or, for browsers, a page with the query and the error."""
    try:
        return await _evaluated(request, endpoint, asked)
    except FleetError as error:
        html = request.services.representations.html
        accept = request.field("accept") if asked.picked is None else _PICKED.get(asked.picked)
        if html is None or choose(accept, (PROBLEM_JSON, *RDF_TYPES, HTML)) != HTML:
            raise
        _, headers = problem(error, HTML, html=html)
        body = page.refusal_page(asked.query, request.base, request.reader(PATH), error)
        return Response(
            body, error.status, headers | {"content-security-policy": html.content_security_policy(forms=True)}
        )


async def _evaluated(request: Request, endpoint: Endpoint, asked: _ParsedQuery) -> Response:
    query = await request.services.offload.run(
        partial(parse_query, asked.query, request.base + PATH), len(asked.query), _SHORT
    )
    media_type = _chosen(request, query, asked.picked)
    body = await endpoint.queries.run(
        query,
        request.base,
        endpoint.view.visible_robots,
        media_type,
        dataset=asked.dataset,
        client=request.caller_name,
        reader=request.reader(PATH),
    )
    content_type = media_type + ("; charset=utf-8" if media_type.startswith("text/") else "")
    html = request.services.representations.html
    policy = html.content_security_policy(forms=True) if html is not None and media_type == HTML else _INERT
    return Response(body, headers=_HEADERS | {"content-type": content_type, "content-security-policy": policy})


def _chosen(request: Request, query: Query, picked: str | None) -> str:
    offered: tuple[str, ...] = _SOLUTIONS if query.form == "SELECT" else _BOOLEANS if query.form == "ASK" else _GRAPHS
    if request.services.representations.html is None:
        offered = tuple(each for each in offered if each != HTML)
    if picked is not None and picked not in _PICKED:
        raise NotAcceptable(f"&as= picks one of {', '.join(_PICKED)}.", offered=tuple(_PICKED))
    accept = request.field("accept") if picked is None else _PICKED[picked]
    chosen = choose(accept, offered)
    if chosen is None:
        raise NotAcceptable(f"Results of {query.form} are available as {', '.join(offered)}.", offered=offered)
    return chosen


async def _counts(endpoint: Endpoint, client: str) -> dict[str, int]:
    """Return numbers of triples by graph; empty before the first query, or while the process is busy."""
    queries, view = endpoint.queries, endpoint.view
    if not queries.running:
        return {}
    try:
        rows = await queries.select(_COUNTS, view.base, view.visible_robots, client=client)
    except FleetError:
        return {}
    return {row["graph"].value: int(row["triples"].value) for row in rows}


class QueryExtension(Extension):
    name = "query"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    at_root = ("query",)
    navigation = (NavigationEntry("Query", "/query", 30),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.query import page

        return (page.VIEW,)

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with Queries(core.live, navigation=core.navigation) as queries:
            yield Mount(
                branches=(branch(queries),),
                readers={Endpoint: read_query},
                writers={PostQuery: post_query},
                services=(queries,),
            )
