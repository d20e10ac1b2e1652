"""GET of a camera in an image media type: the robot is queried for the present picture."""

from email.utils import formatdate

from starlette.responses import Response

from linked_fleet_gateway.base.errors import NotAcceptable
from linked_fleet_gateway.extensions.cameras.cameras import FORMATS
from linked_fleet_gateway.extensions.cameras.pictures import Pictures
from linked_fleet_gateway.extensions.cameras.resources import RobotCamera
from linked_fleet_gateway.http.conditional import not_modified
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.preconditions import await_preconditions
from linked_fleet_gateway.http.read import READ, method_headers, read, resource_headers
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.resource import Resource

# Pictures come from elsewhere: a browser that takes one for a document must not execute anything.
_HEADERS = {"cache-control": "no-store", "content-security-policy": "sandbox; default-src 'none'"}


def _picture_type(request: Request, resource: Resource) -> str | None:
    """Return the requested image media type; None for RDF.

    Raises NotAcceptable with the reason if there are no pictures.
    """
    if "as" in request.query_params:
        return None
    accept, source = field(request, "accept"), resource.remote
    offered = (*request.services.representations.media_types, *resource.documents)
    chosen = choose(accept, offered)
    if (
        chosen is None
        and isinstance(source, RobotCamera)
        and source.camera.unavailable
        and choose(accept, tuple(FORMATS))
    ):
        raise NotAcceptable(f"No picture can be had here: {source.camera.unavailable}.", offered=offered)
    return chosen if chosen in FORMATS else None


async def read_camera(pictures: Pictures, request: Request, resource: Resource, source: RobotCamera) -> Response:
    """Return the RDF of the camera or a picture. Raises NotAcceptable, Offline, AgentSilent and Busy."""
    media_type = _picture_type(request, resource)
    if media_type is not None:
        return await _picture(pictures, request, resource, source, media_type)
    await await_preconditions(request, resource)
    return read(request, resource)


async def _picture(
    pictures: Pictures, request: Request, resource: Resource, source: RobotCamera, media_type: str
) -> Response:
    """Query the robot for a picture, for GET only."""
    headers = resource_headers(resource, request.base, "") | method_headers(resource, READ)
    headers |= _HEADERS | {"content-type": media_type}
    if request.method == "HEAD":
        answer = Response(headers={name: value for name, value in headers.items() if name != "etag"})
        del answer.headers["content-length"]  # unknown without the picture
        return answer
    format = FORMATS[media_type]
    found = await pictures.get(source, format)
    at = found.moment
    headers |= {
        "etag": f'"{at.incarnation}-{at.sequence + 1}-{format}"',
        "last-modified": formatdate(at.wall_ns // 1_000_000_000, usegmt=True),
    }
    if not_modified(field(request, "if-none-match"), headers["etag"]):
        return Response(status_code=304, headers=headers)
    return Response(found.content, headers=headers)
