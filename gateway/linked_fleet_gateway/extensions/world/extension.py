"""The extension ``world``: placements, objects and zones, poses between frames, and collision checks of motions.

Clients create, replace and delete objects over HTTP, and read poses in the frames that the query of the URL names.
"""

import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import unquote

from pyoxigraph import Literal, Triple
from starlette.responses import Response

from linked_fleet_base.errors import BadRequest, NotFound
from linked_fleet_gateway.api import (
    Core,
    Extension,
    Mount,
    NavigationEntry,
    Request,
    RequestView,
    Resource,
    Robot,
    body_type,
    read_resource,
)
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world.descriptions import (
    OBJECTS,
    POSES,
    describe_relative_pose,
    object_form,
    object_path,
    read_object,
)
from linked_fleet_gateway.extensions.world.held import StatedObject
from linked_fleet_gateway.extensions.world.map_requests import put_map, read_image
from linked_fleet_gateway.extensions.world.map_resources import MapImage, PutMap
from linked_fleet_gateway.extensions.world.motion_watch import MotionWatch
from linked_fleet_gateway.extensions.world.operations import operations
from linked_fleet_gateway.extensions.world.path_watch import PathWatch
from linked_fleet_gateway.extensions.world.placement import LF, WORLD, placement, placement_of
from linked_fleet_gateway.extensions.world.relocalise import Relocalise
from linked_fleet_gateway.extensions.world.resources import PoseQuery, PostObject, PutObject
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.faces import managed_statements, relative_pose
from linked_fleet_gateway.serving import convert_body, parse_body, parse_form, read_change, resolve_under_preconditions
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.validation import ground_statements

MAX_BODY_BYTES = 768 * 1024  # of a mesh in Base64
MAX_TRIPLES = 200
_LONGEST_NAMED = 200


async def post_object(world: World, request: Request, afforded: PostObject) -> Response:
    """Create an object. The response is 201 with Location."""
    stated = read_object(await _read(request, request.base + OBJECTS), request.base + OBJECTS, request.base + WORLD)
    id = await world.objects.add(stated.settled(_seen(world, request), None, time.time_ns()))
    return Response(status_code=201, headers={"location": request.base + object_path(id), "cache-control": "no-store"})


async def put_object(world: World, request: Request, afforded: PutObject) -> Response:
    """Replace or remove an object. The response is 204."""
    objects, path = world.objects, object_path(afforded.id)
    iri = request.base + path
    own = partial(managed_statements, shape=LF.SceneObjectInput, iri=iri)
    change = await read_change(request, iri, partial(_read, request, iri), own)
    while True:
        # Evaluated in each attempt, because the object may change meanwhile, also at another gateway.
        present = await resolve_under_preconditions(request, lambda: request.tree().resolve(path))
        if present is None:
            raise NotFound("The object has been removed meanwhile.")
        triples, known = change(present), objects.known.get(afforded.id)
        stated = None if triples is None else await _replaced(request, triples, present, known)
        thing = None if stated is None else stated.settled(_seen(world, request), known, time.time_ns())
        if objects.known.get(afforded.id) is not known:
            continue  # another gateway changed it while the body was read
        if await objects.change(afforded.id, thing):
            return Response(status_code=204)


def _seen(world: World, request: Request) -> dict[str, Robot]:
    """Return the robots that the caller may know of."""
    return {name: each for name, each in world.robots.items() if request.caller.visible_robots.includes(name)}


async def _read(request: Request, iri: str) -> list[Triple]:
    media_type = body_type(request, PostObject.body_types)

    def parse(content: bytes) -> list[Triple]:
        if media_type == JSON:
            return parse_form(content, media_type, iri, request.base, object_form, MAX_TRIPLES)
        return parse_body(content, media_type, iri, request.base, MAX_TRIPLES, {LF.stl: MAX_BODY_BYTES})

    return await convert_body(request, parse, MAX_BODY_BYTES)


async def _replaced(
    request: Request, triples: Sequence[Triple], resource: Resource, present: SceneObject | None
) -> StatedObject:
    """Return the object in a body, parsed in a thread if it has a mesh. Raises UnprocessableContent, Busy."""
    seen = ground_statements(resource.full_graph(request.base))
    work = partial(read_object, triples, request.base + resource.path, request.base + WORLD, present, seen)
    meshes = [each.object for each in triples if each.predicate == LF.stl]
    return await request.services.offload.run(
        work, sum(len(each.value) for each in meshes if isinstance(each, Literal))
    )


async def read_pose(world: World, request: Request, resource: Resource, asked: PoseQuery) -> Response:
    """Return the requested pose or, without a query, the template. Raises BadRequest, NotFound."""
    query = request.query_params
    if unknown := [name for name in query if name not in ("of", "in", "as")]:
        raise BadRequest(f"{unknown[0][:50]!r} is not a parameter of a pose; the parameters are of and in, both IRIs.")
    return read_resource(
        request, _posed(world, request, resource, asked) if "of" in query or "in" in query else resource
    )


def _posed(world: World, request: Request, resource: Resource, asked: PoseQuery) -> Resource:
    of, frame = _path(request, "of"), _path(request, "in")
    try:
        found = relative_pose(of, frame, asked.view.robots, world.poses())
    except LookupError as error:
        named = str(error.args[0])[:_LONGEST_NAMED]
        raise NotFound(
            f"{named} is not a frame in the world; frames are the world itself, robots, links and objects."
        ) from error
    path = f"{POSES}?{request.url.query}"
    iri = asked.view.iri(path)
    describe = partial(describe_relative_pose, iri=iri, of=request.base + of, frame=request.base + frame, posed=found)
    return resource.replace(path=path, title="Pose in a frame", describe=describe)


def _path(request: Request, name: str) -> str:
    said = request.query_params.getlist(name)
    if not said and name == "in":
        return WORLD
    if len(said) != 1 or not said[0].startswith(request.base + "/"):
        raise BadRequest(f"{name} is one IRI of this fleet; here they begin with {request.base}/.")
    return unquote(said[0][len(request.base) :])


PREPARING = "the shapes of robots are being prepared for the check of their motions"


class WorldExtension(Extension):
    name = "world"
    needs = ("models",)
    guards_motions = True
    at_root = ("world",)
    in_robot = ("placement",)
    robot_properties = (placement,)
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    kinds = (Path(__file__).with_name("relocalise.ttl"), Path(__file__).with_name("may_touch.ttl"))
    component_things: ClassVar[Mapping[tuple[str, str], Mapping[str, tuple[str, str]]]] = {
        (LF.Gripper.value, "grasp"): {"object": (LF.object.value, "the object of the world to grasp")}
    }
    placements = (placement_of,)
    navigation = (NavigationEntry("World", "/world", 10),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.world import page

        return (
            page.VIEW,
            page.COLLISIONS_VIEW,
            page.MAP_VIEW,
            page.CONTAINER_VIEW,
            page.OBJECT_VIEW,
            page.UNREADABLE_VIEW,
        )

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        meshes, folder = core.service(Meshes), core.state_path / "meshes"
        async with (
            World(core, meshes, folder) as world,
            PathWatch(world.checks, core.robots, core.live.invocations.open_of_robot, core.cancel),
            MotionWatch(world.checks, core.robots, core.live.invocations.get, core.cancel),
        ):
            with core.listening_to_descriptions(world.mark_held_changed, world.mark_held_changed):
                yield Mount(
                    branches=(world.branch,),
                    readers={PoseQuery: partial(read_pose, world), MapImage: read_image},
                    writers={
                        PostObject: partial(post_object, world),
                        PutObject: partial(put_object, world),
                        PutMap: partial(put_map, world.maps),
                    },
                    handlers={LF.Relocalise: Relocalise(core).plan},
                    guard=world.checks,
                    services=(world,),
                    not_ready=lambda: "" if world.checks.prepared else PREPARING,
                )
