"""The description over HTTP, with content negotiation and an entity tag."""

from dataclasses import dataclass

from starlette.responses import Response

from linked_fleet_gateway.base.errors import NotAcceptable, PreconditionFailed
from linked_fleet_gateway.extensions.openapi.document import PATH, TYPE, Documents
from linked_fleet_gateway.http.conditional import etag, not_modified, precondition_holds
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.read import allowed, method_headers, resource_headers
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.serialise import JSON
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.branches import Found, RequestView
from linked_fleet_gateway.resources.resource import Resource

TYPES = (TYPE, JSON)


@dataclass(frozen=True)
class Described:
    """The description as the caller sees it."""

    view: RequestView


def resolve(view: RequestView, rest: list[str]) -> Found:
    """``rest``: the segments below the description's path, where nothing exists."""
    types = (LDP.Resource,)
    return None if rest else Resource(PATH, "OpenAPI", None, types, remote=Described(view), followed=False)


async def read_description(documents: Documents, request: Request, resource: Resource, of: Described) -> Response:
    """Return the description, or 304. Raises NotAcceptable and PreconditionFailed."""
    media_type = choose(field(request, "accept"), TYPES)
    if media_type is None:
        raise NotAcceptable(f"Available here: {', '.join(TYPES)}.", offered=TYPES)
    body = await documents.of(of.view)
    tag = etag(media_type.encode() + body)
    if not precondition_holds(field(request, "if-match"), {tag}):
        raise PreconditionFailed("The description has changed since.")
    headers = resource_headers(resource, request.base, tag)
    if not_modified(field(request, "if-none-match"), tag):
        return Response(status_code=304, headers=headers)
    headers |= {"content-type": media_type} | method_headers(resource, allowed(resource))
    return Response(body, headers=headers)
