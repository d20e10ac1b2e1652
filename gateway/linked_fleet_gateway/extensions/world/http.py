"""HTTP for objects of the world, and for poses in the frames that a query names."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from urllib.parse import unquote

from pyoxigraph import Literal, Triple
from starlette.responses import Response

from linked_fleet_gateway.base.errors import BadRequest, NotFound
from linked_fleet_gateway.extensions.world.body import object_form, read_object
from linked_fleet_gateway.extensions.world.describe import OBJECTS, POSES, describe_posed, object_path
from linked_fleet_gateway.extensions.world.placement import WORLD
from linked_fleet_gateway.extensions.world.resources import PoseQuery, PostObject, PutObject
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.extensions.world.terms import LF
from linked_fleet_gateway.http.body import body_type, parse_body, parse_form, read_as
from linked_fleet_gateway.http.invoke import refuse_rehearsal
from linked_fleet_gateway.http.offload import Offload
from linked_fleet_gateway.http.patch import apply_patch, read_patch
from linked_fleet_gateway.http.preconditions import present_under_preconditions
from linked_fleet_gateway.http.read import read
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.serialise import JSON
from linked_fleet_gateway.rdf.unused import shown
from linked_fleet_gateway.resources.relative_poses import relative_pose
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.setting import managed_statements

MAX_BODY_BYTES = 768 * 1024  # of a mesh in Base64
MAX_TRIPLES = 200
_LONGEST_NAMED = 200


async def post_object(world: World, request: Request, afforded: PostObject) -> Response:
    """Create an object. The response is 201 with Location."""
    refuse_rehearsal(request)
    thing = read_object(await _read(request, request.base + OBJECTS), request.base + OBJECTS, request.base + WORLD)
    id = await world.objects.add(thing)
    return Response(status_code=201, headers={"location": request.base + object_path(id), "cache-control": "no-store"})


async def put_object(world: World, request: Request, afforded: PutObject) -> Response:
    """Replace or remove an object. The response is 204."""
    refuse_rehearsal(request)
    objects, path = world.objects, object_path(afforded.id)
    change = await _change(request, request.base + path)
    while True:
        # Evaluated in each attempt, because the object may change meanwhile, also at another gateway.
        present = await present_under_preconditions(request, lambda: request.tree().resolve(path))
        if present is None:
            raise NotFound("Somebody has taken the object away meanwhile.")
        triples, known = change(present), objects.known[afforded.id]
        thing = None if triples is None else await _replaced(request, triples, present, known)
        if objects.known.get(afforded.id) is not known:
            continue  # another gateway changed it while the body was read
        if await objects.change(afforded.id, thing):
            return Response(status_code=204)


async def _change(request: Request, iri: str) -> Callable[[Resource], list[Triple] | None]:
    """Return a function from the present resource to its new description; None if the object is to be removed."""
    if request.method == "DELETE":
        return lambda present: None
    if request.method == "PUT":
        triples = await _read(request, iri)
        return lambda present: triples
    update = await read_patch(request, iri)
    own = partial(managed_statements, shape=LF.SceneObjectInput, iri=iri)
    return lambda present: apply_patch(update, present, request.base, own)


async def _read(request: Request, iri: str) -> list[Triple]:
    media_type = body_type(request, PostObject.body_types)

    def parse(content: bytes) -> list[Triple]:
        if media_type == JSON:
            return parse_form(content, media_type, iri, request.base, object_form, MAX_TRIPLES)
        return parse_body(content, media_type, iri, request.base, MAX_TRIPLES, {LF.stl: MAX_BODY_BYTES})

    return await read_as(request, parse, MAX_BODY_BYTES)


async def _replaced(
    request: Request, triples: Sequence[Triple], resource: Resource, present: SceneObject | None
) -> SceneObject:
    """Return the object in a body, parsed in a thread if it has a mesh. Raises UnprocessableContent, Busy."""
    seen = shown(resource.whole(request.base))
    work = partial(read_object, triples, request.base + resource.path, request.base + WORLD, present, seen)
    offload: Offload = request.services.offload
    meshes = [each.object for each in triples if each.predicate == LF.stl]
    return await offload.run(work, sum(len(each.value) for each in meshes if isinstance(each, Literal)))


async def read_pose(world: World, request: Request, resource: Resource, asked: PoseQuery) -> Response:
    """Return the requested pose or, without a query, the template. Raises BadRequest, NotFound."""
    query = request.query_params
    if unknown := [name for name in query if name not in ("of", "in", "as")]:
        raise BadRequest(f"{unknown[0][:50]!r} is nothing to ask for a pose by; of and in are, by IRIs.")
    return read(request, _posed(world, request, resource, asked) if "of" in query or "in" in query else resource)


def _posed(world: World, request: Request, resource: Resource, asked: PoseQuery) -> Resource:
    of, frame = _path(request, "of"), _path(request, "in")
    try:
        found = relative_pose(of, frame, asked.view.robots, world.poses())
    except LookupError as error:
        named = str(error.args[0])[:_LONGEST_NAMED]
        raise NotFound(f"{named} is no place in the world: that is itself, robots, links and objects.") from error
    path = f"{POSES}?{request.url.query}"
    iri = asked.view.iri(path)
    describe = partial(describe_posed, iri=iri, of=request.base + of, frame=request.base + frame, posed=found)
    return replace(resource, path=path, title="Pose in a frame", describe=describe)


def _path(request: Request, name: str) -> str:
    said = request.query_params.getlist(name)
    if not said and name == "in":
        return WORLD
    if len(said) != 1 or not said[0].startswith(request.base + "/"):
        raise BadRequest(f"{name} is one IRI of this fleet; here they begin with {request.base}/.")
    return unquote(said[0][len(request.base) :])
