"""The extension ``cameras``: cameras of robots as resources, their pictures, and streams of them.

A GET of a camera in an image media type queries the robot for the present picture.
"""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from email.utils import formatdate
from functools import partial
from pathlib import Path
from typing import Any

from starlette.responses import Response

from linked_fleet_base.errors import NotAcceptable
from linked_fleet_gateway.api import (
    Content,
    Core,
    Extension,
    Mount,
    NavigationEntry,
    Request,
    RequestView,
    Resource,
    choose,
    read_resource,
)
from linked_fleet_gateway.extensions.cameras.cameras import FORMATS
from linked_fleet_gateway.extensions.cameras.operations import operations
from linked_fleet_gateway.extensions.cameras.pictures import Pictures
from linked_fleet_gateway.extensions.cameras.resources import (
    PATH,
    RobotCamera,
    cameras_branch,
    mounted_cameras,
    wall_branch,
)
from linked_fleet_gateway.serving import await_preconditions

# Pictures come from robots, so a browser that opens one as a document must not execute anything in it.
_HEADERS = {"cache-control": "no-store", "content-security-policy": "sandbox; default-src 'none'"}


def _picture_type(request: Request, resource: Resource) -> str | None:
    """Return the requested image media type; None for RDF.

    Raises NotAcceptable with the reason if there are no pictures.
    """
    if "as" in request.query_params:
        return None
    accept, source = request.field("accept"), resource.remote
    offered = (*request.services.representations.media_types, *resource.documents)
    chosen = choose(accept, offered)
    if (
        chosen is None
        and isinstance(source, RobotCamera)
        and source.camera.unavailable
        and choose(accept, tuple(FORMATS))
    ):
        raise NotAcceptable(f"No picture is available here: {source.camera.unavailable}.", offered=offered)
    return chosen if chosen in FORMATS else None


async def read_camera(pictures: Pictures, request: Request, resource: Resource, source: RobotCamera) -> Response:
    """Return the RDF of the camera or a picture. Raises NotAcceptable, Offline, AgentTimeout and Busy."""
    media_type = _picture_type(request, resource)
    if media_type is not None:
        return await _picture(pictures, request, resource, source, media_type)
    await await_preconditions(request, resource)
    return read_resource(request, resource)


async def _picture(
    pictures: Pictures, request: Request, resource: Resource, source: RobotCamera, media_type: str
) -> Response:
    """Query the robot for a picture, for GET only. Raises PreconditionFailed, Offline, AgentTimeout and Busy."""
    headers = Content.headers(request, resource, media_type) | _HEADERS
    if request.method == "HEAD":
        answer = Response(headers=headers)
        del answer.headers["content-length"]  # unknown without the picture
        return answer
    format = FORMATS[media_type]
    found = await pictures.get(source, format)
    at = found.moment
    headers["last-modified"] = formatdate(at.wall_ns // 1_000_000_000, usegmt=True)
    return Content(found.content, f'"{at.incarnation}-{at.sequence + 1}-{format}"').response(request, headers)


class CamerasExtension(Extension):
    name = "cameras"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    in_robot = ("cameras",)
    at_root = (PATH[1:],)
    navigation = (NavigationEntry("Cameras", PATH, 37),)
    link_statements = (mounted_cameras,)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.cameras import page

        return page.VIEWS

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with Pictures(core.live) as pictures:
            yield Mount(
                branches=(cameras_branch(pictures.latest), wall_branch()),
                readers={RobotCamera: partial(read_camera, pictures)},
                subprotocols={"lf.jpeg": "image/jpeg", "lf.png": "image/png"},
                services=(pictures,),
            )
