"""The query endpoint as a resource: its service description (SPARQL 1.1 Service Description, VoID) and page."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import Demand, FleetBranch, Found, RequestView, Resource, Right, robot_path
from linked_fleet_gateway.extensions.query.examples import EXAMPLES
from linked_fleet_gateway.extensions.query.functions import FUNCTIONS, LF
from linked_fleet_gateway.extensions.query.rdf_mirror import SHAPES
from linked_fleet_gateway.extensions.query.service import Queries
from linked_fleet_gateway.faces import VOCABULARY
from linked_fleet_rdf.graph import Graph, integer
from linked_fleet_rdf.vocabulary import DCTERMS, FORMAT, PREFIXES, RDFS, SD, SH, VOID
from linked_fleet_state.functions import added_functions

PATH = "/query"
FORM = "application/x-www-form-urlencoded"
QUERY_TYPES = ("application/sparql-query", FORM)
_FORMATS = (
    FORMAT.SPARQL_Results_JSON, FORMAT.SPARQL_Results_XML, FORMAT.SPARQL_Results_CSV, FORMAT.SPARQL_Results_TSV,
    FORMAT.Turtle, FORMAT.terms["JSON-LD"], FORMAT.terms["N-Triples"], FORMAT.RDF_XML,
)  # fmt: skip


@dataclass(frozen=True)
class Endpoint:
    """The endpoint of queries; ``view`` is that of the caller."""

    queries: Queries
    view: RequestView


@dataclass(frozen=True)
class PostQuery:
    """A query by POST, which is safe."""

    endpoint: Endpoint
    methods: ClassVar[tuple[str, ...]] = ("POST",)
    body_types: ClassVar[tuple[str, ...]] = QUERY_TYPES
    reads: ClassVar[bool] = True
    honours: ClassVar[frozenset[Demand]] = frozenset(Demand) - {Demand.RESPONSE}  # a query changes nothing
    needs: ClassVar[tuple[Right, ...]] = (Right.READ,)


def branch(queries: Queries) -> FleetBranch:
    return FleetBranch(PATH[1:], LF.query, partial(_resolve, queries))


def _resolve(queries: Queries, view: RequestView, rest: list[str]) -> Found:
    return None if rest else endpoint_resource(Endpoint(queries, view), {})


def endpoint_resource(endpoint: Endpoint, counts: Mapping[str, int]) -> Resource:
    """Return the resource; ``counts`` are numbers of triples by graph IRI, as far as known."""
    return Resource(
        PATH,
        "Query",
        lambda graph: _describe(graph, endpoint.view, counts),
        affords=PostQuery(endpoint),
        remote=endpoint,
        publishes_changes=False,
        has_form=True,
    )


def _describe(graph: Graph, view: RequestView, counts: Mapping[str, int]) -> None:
    iri = view.iri(PATH)
    graph.a(iri, SD.Service)
    graph.add(iri, DCTERMS.title, Literal("Query the fleet"))
    graph.add(
        iri, RDFS.comment, Literal("SPARQL over the live fleet: every query is evaluated on a consistent snapshot.")
    )
    graph.add(iri, RDFS.seeAlso, view.iri("/"))
    graph.add(iri, SD.endpoint, iri)
    graph.add(iri, SD.supportedLanguage, SD.SPARQL11Query)
    graph.add(iri, SD.resultFormat, *_FORMATS)
    graph.add(iri, SD.feature, SD.UnionDefaultGraph)
    graph.add(iri, SD.extensionFunction, *FUNCTIONS, *(name for make in added_functions() for name in make().names))
    _dataset(graph, iri, view, counts)
    for each in EXAMPLES:
        example = graph.blank(SH.SPARQLSelectExecutable)
        graph.add(iri, LF.example, example)
        graph.add(example, DCTERMS.title, Literal(each.title))
        graph.add(example, RDFS.comment, Literal(each.comment))
        graph.add(example, SH.select, Literal(each.text))


def _dataset(graph: Graph, iri: NamedNode, view: RequestView, counts: Mapping[str, int]) -> None:
    dataset, union = graph.blank(SD.Dataset, VOID.Dataset), graph.blank(SD.Graph, VOID.Dataset)
    graph.add(iri, SD.defaultDataset, dataset)
    graph.add(dataset, VOID.sparqlEndpoint, iri)
    graph.add(dataset, VOID.uriSpace, Literal(view.base + "/"))
    graph.add(dataset, VOID.vocabulary, *map(NamedNode, PREFIXES.values()))
    graph.add(dataset, SD.defaultGraph, union)
    _count(graph, union, sum(counts.values()) if counts else None)
    for path in _graphs(view):
        named, of = graph.blank(SD.NamedGraph), graph.blank(SD.Graph, VOID.Dataset)
        graph.add(dataset, SD.namedGraph, named)
        graph.add(named, SD.name, view.iri(path))
        graph.add(named, SD.graph, of)
        _count(graph, of, counts.get(view.base + path))


def _graphs(view: RequestView) -> Iterable[str]:
    return "/", VOCABULARY, SHAPES, *map(robot_path, view.robots)


def _count(graph: Graph, node: NamedNode | object, count: int | None) -> None:
    if count is not None:
        graph.add(node, VOID.triples, integer(count))  # type: ignore[arg-type]
