"""The answer to what makes a resource: where it is, and what it is."""

from starlette.responses import Response

from gateway.http.representation import Representation
from gateway.resources.resource import Resource


def created(resource: Resource, representation: Representation, base: str) -> Response:
    """201 with Location and the description (RFC 9110, 15.3.2)."""
    headers = {
        "location": base + resource.path,
        "content-location": base + resource.path,
        "content-type": representation.content_type,
        "etag": representation.etag,
        "cache-control": "no-store",
        "vary": "Accept",
    }
    return Response(representation.body, 201, headers)
