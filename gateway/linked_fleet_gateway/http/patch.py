"""PATCH of one resource by a SPARQL update (RFC 5789; LDP 4.2.7); the result is handled like PUT."""

from collections.abc import Callable, Iterable, Sequence

from pyoxigraph import Triple

from linked_fleet_gateway.base.errors import BadRequest, UnsupportedMediaType
from linked_fleet_gateway.http.body import body_type, read_as
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.sparql_syntax import MAX_QUERY_BYTES
from linked_fleet_gateway.rdf.sparql_update import Operation, read_update, updated
from linked_fleet_gateway.rdf.unused import refuse
from linked_fleet_gateway.resources.resource import Resource

PATCH_TYPES = ("application/sparql-update",)
Managed = Callable[[Sequence[Triple]], Iterable[Triple]]
"""Returns the statements of a description that clients cannot remove."""


async def read_patch(request: Request, iri: str) -> list[Operation]:
    """Return the update in the body, with ``iri`` as base.

    Raises BadRequest, PayloadTooLarge, Busy, UnsupportedMediaType.
    """
    try:
        body_type(request, PATCH_TYPES)
    except UnsupportedMediaType as error:
        error.headers["Accept-Patch"] = ", ".join(PATCH_TYPES)
        raise
    return await read_as(request, lambda content: _read(content, iri), MAX_QUERY_BYTES)


def _read(content: bytes, iri: str) -> list[Operation]:
    try:
        return read_update(content.decode("utf-8-sig"), iri)
    except UnicodeDecodeError as error:
        raise BadRequest("The update is not UTF-8.") from error


def apply_patch(operations: Sequence[Operation], resource: Resource, base: str, managed: Managed) -> list[Triple]:
    """Return the description after the update. Raises UnprocessableContent if it removes managed statements."""
    graph = resource.whole(base)
    after = updated(graph.triples, operations)
    left = set(after)
    refuse(
        [triple for triple in managed(graph.triples) if triple not in left],
        f"{base}{resource.path}/blueprint",
        "No client takes back",
    )
    return after
