"""The resources at ``/world`` and below. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar
from zlib import crc32

from linked_fleet_gateway.api import CONTAINER, Found, RequestView, Resource, Right, Source, blueprint_of
from linked_fleet_gateway.extensions.world.collisions import COLLISIONS, NONE, Known, resolve_collisions
from linked_fleet_gateway.extensions.world.descriptions import (
    OBJECTS,
    POSES,
    STL,
    UNREADABLE,
    describe_object,
    describe_objects,
    describe_template,
    describe_unreadable,
    describe_world,
    object_path,
)
from linked_fleet_gateway.extensions.world.floor_map import NO_MAPS, Maps
from linked_fleet_gateway.extensions.world.held import path_of
from linked_fleet_gateway.extensions.world.map_resources import MAP, resolve_map
from linked_fleet_gateway.extensions.world.placement import LF, PLACEMENT, WORLD
from linked_fleet_gateway.extensions.world.scene import SceneObject, TriangleMesh, Unreadable
from linked_fleet_rdf.serialise import JSON, TEXT_TYPES
from linked_fleet_rdf.vocabulary import LDP

_BLUEPRINT = "blueprint"


@dataclass(frozen=True)
class PostObject:
    """Add an object to the world."""

    methods: ClassVar[tuple[str, ...]] = ("POST",)
    body_types: ClassVar[tuple[str, ...]] = (*TEXT_TYPES, JSON)
    reads: ClassVar[bool] = False
    needs: ClassVar[tuple[Right, ...]] = (Right.ADMIN,)


@dataclass(frozen=True)
class PutObject:
    """Replace an object, or remove it from the world."""

    id: str
    methods: ClassVar[tuple[str, ...]] = ("PUT", "PATCH", "DELETE")
    body_types: ClassVar[tuple[str, ...]] = (*TEXT_TYPES, JSON)
    reads: ClassVar[bool] = False
    needs: ClassVar[tuple[Right, ...]] = (Right.ADMIN,)


@dataclass(frozen=True)
class PoseQuery:
    """A pose in the frame that the query names."""

    view: RequestView


def resolve_world(
    view: RequestView,
    rest: list[str],
    objects: Mapping[str, SceneObject],
    collisions: Known = NONE,
    maps: Maps = NO_MAPS,
    unreadable: Unreadable = tuple,
) -> Found:
    """Return the resource at ``rest``, the segments below ``/world``.

    ``unreadable`` returns the paths of what is there and cannot be read.
    """
    if not rest:
        return _world(view)
    if rest == [_BLUEPRINT]:
        return blueprint_of(_world(view), view.base, (LF.WorldShape,))
    if rest == ["pose"]:
        template = "Poses of things in the frames of others"
        return Resource(
            POSES,
            template,
            lambda graph: describe_template(graph, view.base),
            remote=PoseQuery(view),
            publishes_changes=False,
        )
    if rest[0] == "collisions":
        return resolve_collisions(view, rest[1:], collisions)
    if rest[0] == "map":
        return resolve_map(view, rest[1:], maps, lambda: MAP not in unreadable())
    if rest[0] != "objects":
        return None
    return _in_objects(view, rest[1:], objects, lambda: [each for each in unreadable() if each != MAP])


def _world(view: RequestView) -> Resource:
    robots = view.robots
    return Resource(
        WORLD,
        "World",
        lambda graph: describe_world(graph, view.base, robots.values(), view.faults),
        source=Source(
            lambda: [(r.name, r.title, r.description is None, r.settings.get(PLACEMENT)) for r in robots.values()]
        ),
        own_paths=(f"{WORLD}/{_BLUEPRINT}", OBJECTS, POSES, COLLISIONS, MAP),
        publishes_changes=False,  # clients follow the placements and the objects instead
    )


def _in_objects(
    view: RequestView, rest: list[str], objects: Mapping[str, SceneObject], unreadable: Unreadable
) -> Resource | None:
    if not rest or rest == [_BLUEPRINT]:
        container = Resource(
            OBJECTS,
            "Objects of the world",
            lambda graph: describe_objects(graph, view.base, objects, view.robots, unreadable=unreadable()),
            CONTAINER,
            Source(
                lambda: [unreadable(), *((id, each, _holder(view, each)) for id, each in objects.items())],
                shared_facts=lambda: [unreadable(), *((id, *_facts(view, each)) for id, each in objects.items())],
            ),
            own_paths=(f"{OBJECTS}/{_BLUEPRINT}",),
            part_paths=(*map(object_path, objects), *unreadable()),
            affords=PostObject(),
        )
        return blueprint_of(container, view.base, (LF.SceneObjectsShape, LF.SceneObjectInput)) if rest else container
    thing, path = objects.get(rest[0]), object_path(rest[0])
    if thing is not None:
        return _of_object(view, rest[0], thing, rest[1:], objects)
    if path not in unreadable() or len(rest) > 1:
        return None
    return Resource(
        path,
        UNREADABLE,
        lambda graph: describe_unreadable(graph, view.iri(path)),
        source=Source(lambda: path in unreadable()),
        affords=PutObject(rest[0]),
    )


def _of_object(
    view: RequestView, id: str, thing: SceneObject, rest: list[str], objects: Mapping[str, SceneObject]
) -> Resource | None:
    path, geometry = object_path(id), thing.geometry
    if not rest or rest == [_BLUEPRINT]:
        mesh = (f"{path}/mesh",) if isinstance(geometry, TriangleMesh) else ()
        whole = Resource(
            path,
            thing.title,
            lambda graph: describe_object(graph, view.base, id, thing, view.robots),
            source=Source(
                lambda: (objects.get(id), _holder(view, objects.get(id))),
                shared_facts=lambda: _facts(view, objects.get(id)),
            ),
            own_paths=(f"{path}/{_BLUEPRINT}", *mesh),
            affords=PutObject(id),
        )
        return blueprint_of(whole, view.base, (LF.SceneObjectShape, LF.SceneObjectInput)) if rest else whole
    if rest == ["mesh"] and isinstance(geometry, TriangleMesh):
        documents = {STL: lambda: geometry.stl}
        return Resource(
            f"{path}/mesh", f"Mesh of {thing.title}", None, (LDP.Resource, LDP.NonRDFSource), documents=documents
        )
    return None


def _holder(view: RequestView, thing: SceneObject | None) -> str:
    """Return the path of the link that holds an object, as far as the reader may know it; empty for none."""
    return "" if thing is None or thing.held is None else path_of(thing.held, view.robots)


def _facts(view: RequestView, thing: SceneObject | None) -> tuple[object, ...]:
    """Return the facts that determine the version: all of an object, with a fast checksum of a mesh."""
    if thing is None:
        return ()
    geometry = thing.geometry
    form = crc32(geometry.stl) if isinstance(geometry, TriangleMesh) else geometry
    place = thing.pose if thing.held is None else (thing.held.pose, _holder(view, thing))
    return thing.title, thing.kind, place, form
