"""The response with a rehearsal: of an action, or of a record that a client would write."""

from collections.abc import Callable

from pyoxigraph import NamedNode
from starlette.responses import Response

from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.validation import find_root
from linked_fleet_rdf.vocabulary import LF


def rehearsal_response(
    request: Request, path: str, title: str, describe: Callable[[Graph], None], applied: str
) -> Response:
    """Return the response with what ``describe`` says, in the media type of the request; ``applied``: preferences."""

    def plain() -> bytes:
        from linked_fleet_gateway.resources.plain_json import node_json

        graph = Graph()
        describe(graph)
        root = find_root(graph.triples, NamedNode(request.base + path))
        return node_json(graph.triples, root, LF.RehearsalShape)

    rehearsal = Resource(path, title, describe, (), documents={JSON: plain})
    shown = request.services.representations.negotiate(request.effective_accept, rehearsal, request.base)
    headers = {"content-type": shown.content_type, "cache-control": "no-store", "vary": "Accept, Prefer"}
    return Response(shown.body, 200, headers | {"preference-applied": applied})
