"""Operations of queries in OpenAPI."""

from linked_fleet_gateway.api import RequestView
from linked_fleet_gateway.extensions.openapi.api import RDF_CONTENT, Json, parameter, path_item, write_operation
from linked_fleet_gateway.extensions.query.description import (
    PATH,
)
from linked_fleet_gateway.extensions.query.service import JSON_RESULTS
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.sparql_tokens import MAX_QUERY_BYTES

_TEXT: Json = {"type": "string", "minLength": 1, "maxLength": MAX_QUERY_BYTES, "examples": ["ASK { ?s ?p ?o }"]}
_LONGEST_IN_URL = 1000
"""Limit of characters of a query in a URL, where each may take a dozen; longer ones are sent by POST."""
_RESULTS: Json = {"schema": {"type": "object", "required": ["head"]}}
_ANSWERS: Json = {JSON_RESULTS: _RESULTS, JSON: _RESULTS, "application/sparql-results+xml": {}, "text/csv": {}}


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items for queries by GET and POST (SPARQL 1.1 Protocol, 2.1), with results by query form."""
    short = _TEXT | {"maxLength": _LONGEST_IN_URL}
    query = parameter("query", "query", short, "A query of SPARQL 1.1; without one, the endpoint describes itself.")
    found: Json = {"200": {"description": "The result.", "content": {**_ANSWERS, **RDF_CONTENT}}}
    body: Json = {"application/sparql-query": {"schema": _TEXT}}
    return {
        PATH: path_item(
            {},
            get=write_operation("query", "Ask the whole fleet", found, None, [query]),
            post=write_operation("postQuery", "Ask the whole fleet by a long query", found, body),
        )
    }
