"""Objects of the world over HTTP, and poses in the frames that a query names."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from urllib.parse import unquote

from pyoxigraph import Literal, Triple
from starlette.requests import Request
from starlette.responses import Response

from gateway.base.errors import BadRequest, NotFound
from gateway.extensions.world.body import read_object
from gateway.extensions.world.describe import OBJECTS, POSES, describe_posed, object_path
from gateway.extensions.world.resources import AskPose, PostObject, PutObject
from gateway.extensions.world.scene import SceneObject
from gateway.extensions.world.service import World
from gateway.http.body import body_type, parse_body, read_as
from gateway.http.invoke import refuse_rehearsal
from gateway.http.offload import Offload
from gateway.http.patch import patched, read_patch
from gateway.http.preconditions import present_under_preconditions
from gateway.http.rights import tree_of
from gateway.rdf.unused import shown
from gateway.rdf.vocabulary import LF
from gateway.resources.placement import WORLD
from gateway.resources.relative_poses import seen_from
from gateway.resources.resource import Resource
from gateway.resources.setting import managed

MAX_BODY_BYTES = 768 * 1024  # of a mesh in Base64
MAX_TRIPLES = 200
_LONGEST_NAMED = 200


async def post_object(request: Request, afforded: PostObject, base: str) -> Response:
    """201 with Location."""
    refuse_rehearsal(request)
    thing = read_object(await _read(request, base + OBJECTS, base), base + OBJECTS, base + WORLD)
    id = await _world(request).objects.add(thing)
    return Response(status_code=201, headers={"location": base + object_path(id), "cache-control": "no-store"})


async def put_object(request: Request, afforded: PutObject, base: str) -> Response:
    """204: replaced, or taken away."""
    refuse_rehearsal(request)
    objects, path = _world(request).objects, object_path(afforded.id)
    change = await _change(request, base + path, base)
    while True:
        # Each time, because it may have changed, or gone, while the body was on its way, or at another gateway.
        present = await present_under_preconditions(request, lambda: tree_of(request, base).resolve(path), base)
        if present is None:
            raise NotFound("Somebody has taken the object away meanwhile.")
        triples, known = change(present), objects.known[afforded.id]
        thing = None if triples is None else await _replaced(request, triples, present, known, base)
        if objects.known.get(afforded.id) is not known:
            continue  # another gateway was faster while the body was read
        if await objects.change(afforded.id, thing):
            return Response(status_code=204)


async def _change(request: Request, iri: str, base: str) -> Callable[[Resource], list[Triple] | None]:
    """The description to be, by the resource as it is at that moment; None when the object is taken away."""
    if request.method == "DELETE":
        return lambda present: None
    if request.method == "PUT":
        triples = await _read(request, iri, base)
        return lambda present: triples
    update = await read_patch(request, iri)
    own = partial(managed, shape=LF.SceneObjectInput, iri=iri)
    return lambda present: patched(update, present, base, own)


async def _read(request: Request, iri: str, base: str) -> list[Triple]:
    media_type = body_type(request)

    def read(content: bytes) -> list[Triple]:
        return parse_body(content, media_type, iri, base, MAX_TRIPLES, {LF.stl: MAX_BODY_BYTES})

    return await read_as(request, read, MAX_BODY_BYTES)


async def _replaced(
    request: Request, triples: Sequence[Triple], resource: Resource, present: SceneObject | None, base: str
) -> SceneObject:
    """The object that a body describes, read in a thread if it has a mesh; UnprocessableContent, Busy."""
    seen = shown(resource.whole(base))
    read = partial(read_object, triples, base + resource.path, base + WORLD, present, seen)
    offload: Offload = request.app.state.offload
    meshes = [each.object for each in triples if each.predicate == LF.stl]
    return await offload.run(read, sum(len(each.value) for each in meshes if isinstance(each, Literal)))


def posed(request: Request, resource: Resource, asked: AskPose, base: str) -> Resource:
    """The pose that the query asks for, or how to ask for one; BadRequest, NotFound."""
    query = request.query_params
    if unknown := [name for name in query if name not in ("of", "in", "as")]:
        raise BadRequest(f"{unknown[0][:50]!r} is nothing to ask for a pose by; of and in are, by IRIs.")
    return _posed(request, resource, asked, base) if "of" in query or "in" in query else resource


def _posed(request: Request, resource: Resource, asked: AskPose, base: str) -> Resource:
    of, frame = _path(request, "of", base), _path(request, "in", base)
    try:
        found = seen_from(of, frame, asked.sight.robots, _world(request).objects.known)
    except LookupError as error:
        named = str(error.args[0])[:_LONGEST_NAMED]
        raise NotFound(f"{named} is no place in the world: that is itself, robots, links and objects.") from error
    path = f"{POSES}?{request.url.query}"
    iri = asked.sight.iri(path)
    describe = partial(describe_posed, iri=iri, of=base + of, frame=base + frame, posed=found)
    return replace(resource, path=path, title="Pose in a frame", describe=describe)


def _path(request: Request, name: str, base: str) -> str:
    said = request.query_params.getlist(name)
    if not said and name == "in":
        return WORLD
    if len(said) != 1 or not said[0].startswith(base + "/"):
        raise BadRequest(f"{name} is one IRI of this fleet; here they begin with {base}/.")
    return unquote(said[0][len(base) :])


def _world(request: Request) -> World:
    world: World = request.app.state.world
    return world
