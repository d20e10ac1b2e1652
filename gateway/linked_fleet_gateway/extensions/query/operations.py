"""Operations on the query endpoint, for descriptions of the whole gateway."""

from linked_fleet_gateway.extensions.query.description import PATH
from linked_fleet_gateway.extensions.query.service import JSON_RESULTS
from linked_fleet_gateway.http.operations import DESCRIBED, parameter, path_item, writing
from linked_fleet_gateway.rdf.serialise import JSON
from linked_fleet_gateway.rdf.sparql_syntax import MAX_QUERY_BYTES
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json

_TEXT: Json = {"type": "string", "minLength": 1, "maxLength": MAX_QUERY_BYTES, "examples": ["ASK { ?s ?p ?o }"]}
_SHORT = 1000
"""Limit of characters of a query in a URL, where each may take a dozen; longer ones are sent by POST."""
_RESULTS: Json = {"schema": {"type": "object", "required": ["head"]}}
_ANSWERS: Json = {JSON_RESULTS: _RESULTS, JSON: _RESULTS, "application/sparql-results+xml": {}, "text/csv": {}}


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items for queries by GET and POST (SPARQL 1.1 Protocol, 2.1), with results by query form."""
    short = _TEXT | {"maxLength": _SHORT}
    query = parameter("query", "query", short, "A query of SPARQL 1.1; without one, the endpoint describes itself.")
    found: Json = {"200": {"description": "The result.", "content": {**_ANSWERS, **DESCRIBED}}}
    body: Json = {"application/sparql-query": {"schema": _TEXT}}
    return {
        PATH: path_item(
            {},
            get=writing("query", "Ask the whole fleet", found, None, [query]),
            post=writing("postQuery", "Ask the whole fleet by a long query", found, body),
        )
    }
