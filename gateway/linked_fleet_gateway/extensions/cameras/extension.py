"""The extension ``cameras``: cameras of robots as resources, their pictures, and streams of them.

A GET of a camera in an image media type queries the robot for the present picture.
"""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from email.utils import formatdate
from functools import partial
from pathlib import Path

from starlette.responses import Response

from linked_fleet_agent.wire.messages import Camera
from linked_fleet_gateway.base.errors import NotAcceptable, PreconditionFailed
from linked_fleet_gateway.extensions.cameras.cameras import FORMATS, camera_path, cameras_of, types_of
from linked_fleet_gateway.extensions.cameras.pictures import Pictures
from linked_fleet_gateway.extensions.cameras.resources import RobotCamera, cameras_branch, mounted_cameras
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.operations import last_segment, rdf_get_operation, resource_path_items, segment_schema
from linked_fleet_gateway.http.preconditions import await_preconditions
from linked_fleet_gateway.http.read import READ_METHODS, method_headers, read_resource, resource_headers
from linked_fleet_gateway.http.representation import not_modified, precondition_holds
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.resource import Resource

# Pictures come from robots, so a browser that opens one as a document must not execute anything in it.
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
    headers = resource_headers(resource, request.base, "") | method_headers(resource, READ_METHODS)
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
    if not precondition_holds(field(request, "if-match"), {headers["etag"]}):
        raise PreconditionFailed(f"The entity tag of the present picture is {headers['etag']}.")
    if not_modified(field(request, "if-none-match"), headers["etag"]):
        return Response(status_code=304, headers=headers)
    return Response(found.content, headers=headers)


class CamerasExtension(Extension):
    name = "cameras"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    in_robot = ("cameras",)
    link_statements = (mounted_cameras,)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.cameras import page

        return (page.VIEW,)

    def operations(self, view: RequestView) -> Mapping[str, Json]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with Pictures(core.live) as pictures:
            yield Mount(
                branches=(cameras_branch(pictures.latest),),
                readers={RobotCamera: partial(read_camera, pictures)},
                subprotocols={"lf.jpeg": "image/jpeg", "lf.png": "image/png"},
                services=(pictures,),
            )


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of a robot's cameras and their pictures."""
    found = list[tuple[Robot, Camera]]()
    for robot in view.robots.values():
        with view.faults.guard("OpenAPI", robot.name, "its cameras"):
            found += [(robot, camera) for camera in cameras_of(robot).values()]
    if not found:
        return {}
    of = {"robot": segment_schema(last_segment(robot_path(each.name)) for each, _ in found)}
    one = of | {"camera": segment_schema(last_segment(camera_path(each.name, camera.name)) for each, camera in found)}
    get = rdf_get_operation("readCamera", "A camera: its description, or its picture")
    get["responses"]["200"]["content"] |= {media_type: {} for _, camera in found for media_type in types_of(camera)}
    return {
        **resource_path_items("/{robot}/cameras", of, "Cameras", "Cameras of a robot"),
        **resource_path_items("/{robot}/cameras/{camera}", one, "Camera", "A camera", get),
    }
