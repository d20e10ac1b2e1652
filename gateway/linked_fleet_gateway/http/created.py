"""The response to the creation of a resource: its location and description."""

from starlette.responses import Response

from linked_fleet_gateway.base.errors import NotAcceptable
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.resource import Resource


def created_response(request: Request, resource: Resource, accept: str | None = None) -> Response:
    """Return 201 with Location and the description (RFC 9110, 15.3.2); ``accept`` overrides the request's field."""
    accept = accept or field(request, "accept")
    representation = request.services.representations.negotiated(accept, resource, request.base)
    location = request.base + resource.path
    headers = {
        "location": location,
        "content-location": location,
        "content-type": representation.content_type,
        "etag": representation.etag,
        "cache-control": "no-store",
        "vary": "Accept",
    }
    return Response(representation.body, 201, headers)


def check_accepted(request: Request) -> None:
    """Raise NotAcceptable, before anything is created, if the client could not read the description."""
    offered = request.services.representations.media_types
    if choose(field(request, "accept"), offered) is None:
        raise NotAcceptable(f"Available here: {', '.join(offered)}.", offered=offered)
