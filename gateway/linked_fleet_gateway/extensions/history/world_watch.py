"""Finds where robots stood in the world, and what objects were in it, for the history on disk.

They are looked at once a second. Of a mesh its digest and its extent are kept, not its triangles.
"""

import asyncio
import hashlib
import logging
import struct
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeVar

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from linked_fleet_gateway.api import Core, Pose, Robot, cancel_tasks, supervised
from linked_fleet_gateway.extensions.history.archive import Archive
from linked_fleet_gateway.extensions.history.segment import PLACEMENTS, UNKNOWN, VALUE, WORLD, Said
from linked_fleet_gateway.extensions.world.placement import placement_of
from linked_fleet_gateway.extensions.world.scene import (
    MAX_OBJECTS,
    Box,
    Cylinder,
    Held,
    SceneObject,
    Sphere,
    TriangleMesh,
)
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_state.kinematics import compose
from linked_fleet_state.xml import Vector

log = logging.getLogger(__name__)

T = TypeVar("T")

OBJECTS = "objects/"
BEGUN = "begun"
"""The path of a value that a gateway writes first: what was known of the world before is over; all of it follows."""
LOOK_S = 1.0
_STEP_NS = 10**6
"""Changes are at whole milliseconds, as they are told, so that what holds from a time on held at that time."""
_THINNEST_M = 1e-3
_UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class MeshTrace(Struct, frozen=True, tag="mesh"):
    """The trace that is kept of a mesh: the start of its SHA-256, and two corners of the box around it."""

    digest: str
    low_m: Vector
    high_m: Vector


class PastObject(Struct, frozen=True, omit_defaults=True):
    """An object of the world as it was. Without a title its record could not be read."""

    title: str = ""
    kind: Literal["obstacle", "zone"] = "obstacle"
    pose: Pose | None = None
    geometry: Box | Sphere | Cylinder | MeshTrace | None = None
    held: Held | None = None

    def drawn(self, present: SceneObject | None) -> tuple[SceneObject, bool] | None:
        """Return the object as it is described, and whether its shape is the one that it had then.

        A mesh that has been replaced since is the box around it. None if its record could not be read.
        """
        if self.pose is None or self.geometry is None:
            return None
        thing = SceneObject(
            title=self.title, kind=self.kind, pose=self.pose, geometry=Box((1.0, 1.0, 1.0)), held=self.held
        )
        if not isinstance(self.geometry, MeshTrace):
            return replace(thing, geometry=self.geometry), True
        now = None if present is None else present.geometry
        if isinstance(now, TriangleMesh) and trace_of(now).digest == self.geometry.digest:
            return replace(thing, geometry=now), True
        return _boxed(thing, self.geometry), False


@lru_cache(maxsize=MAX_OBJECTS)
def trace_of(mesh: TriangleMesh) -> MeshTrace:
    corners = [face[i : i + 3] for face in struct.iter_unpack("<12x9f2x", memoryview(mesh.stl)[84:]) for i in (0, 3, 6)]
    x, y, z = zip(*corners, strict=True)
    digest = hashlib.sha256(mesh.stl).hexdigest()[:32]
    return MeshTrace(digest, (min(x), min(y), min(z)), (max(x), max(y), max(z)))


def _boxed(thing: SceneObject, trace: MeshTrace) -> SceneObject:
    low, high = trace.low_m, trace.high_m
    centre = Pose((_half(low[0], high[0]), _half(low[1], high[1]), _half(low[2], high[2])), _UPRIGHT)
    x, y, z = (max(above - below, _THINNEST_M) for below, above in zip(low, high, strict=True))
    box = Box((x, y, z))
    held = thing.held
    if held is not None:
        return replace(thing, geometry=box, held=replace(held, pose=compose(held.pose, centre)))
    return replace(thing, geometry=box, pose=compose(thing.pose, centre))


def _half(one: float, other: float) -> float:
    return (one + other) / 2


Known = SceneObject | Pose | None
"""An object, where a robot stands, or None for what is not there, or cannot be read."""


@dataclass(frozen=True)
class Change:
    """The news of a path of the world from ``stamp_ns`` on; ``is_there`` is False for an object that is gone."""

    path: str
    known: Known
    stamp_ns: int
    is_there: bool = True

    def said(self) -> Said:
        return Said(WORLD, self.path, VALUE, self._json(), self.stamp_ns)

    def _json(self) -> str:
        if not self.is_there:
            return UNKNOWN
        return msgspec.json.encode(self.known if isinstance(self.known, Pose) else _kept(self.known)).decode()


class WorldWatch:
    """Finds what has changed since it looked last."""

    def __init__(self, world: World, now_ns: Callable[[], int] = lambda: time.time_ns()) -> None:
        self._world, self._now_ns = world, now_ns
        self._begun = False
        self._objects: dict[str, SceneObject | None] = {}
        self._places: dict[str, Pose | None] = {}

    def look(self, robots: Mapping[str, Robot]) -> list[Change]:
        """Return what is known of the world if this is the first look, else what has changed."""
        if not self._world.objects.is_loaded:
            return []  # what was known before still holds, as far as one knows
        now_ns = -(-self._now_ns() // _STEP_NS) * _STEP_NS
        begun = [] if self._begun else [Change(BEGUN, None, now_ns)]
        self._begun = True
        return [*begun, *self._changed_objects(now_ns), *self._changed_places(robots, now_ns)]

    def _changed_objects(self, now_ns: int) -> Iterator[Change]:
        objects = self._world.objects
        now: dict[str, SceneObject | None] = {**dict.fromkeys(objects.unreadable), **objects.known}
        for id in self._objects.keys() - now.keys():
            del self._objects[id]
            yield Change(OBJECTS + id, None, now_ns, is_there=False)
        for id, thing in now.items():
            if id not in self._objects or self._objects[id] is not thing:
                self._objects[id] = thing
                yield Change(OBJECTS + id, thing, now_ns)

    def _changed_places(self, robots: Mapping[str, Robot], now_ns: int) -> Iterator[Change]:
        for name in self._places.keys() - robots.keys():
            del self._places[name]  # it is removed from the files as well
        for name, robot in robots.items():
            place = placement_of(robot)
            if self._places.get(name) != place:
                self._places[name] = place
                yield Change(PLACEMENTS + name, place, now_ns, is_there=place is not None)


def _kept(thing: SceneObject | None) -> PastObject:
    if thing is None:
        return PastObject()
    geometry = trace_of(thing.geometry) if isinstance(thing.geometry, TriangleMesh) else thing.geometry
    return PastObject(thing.title, thing.kind, thing.pose, geometry, thing.held)


def read_kept(json: str, kind: type[T]) -> T | None:
    """Return an object or a placement as it was written; None if it cannot be read."""
    try:
        return msgspec.json.decode(json, type=kind)
    except ValueError:
        return None


@asynccontextmanager
async def watching_world(core: Core, world: World, archive: Archive) -> AsyncIterator[None]:
    """Write where robots stand and what objects there are to disk while the context lasts."""
    watch = WorldWatch(world)

    async def look() -> None:
        if changes := watch.look(core.robots):
            archive.add_values(await asyncio.to_thread(lambda: [each.said() for each in changes]))

    task = supervised(look, "the world on disk", log, "the world is not kept", LOOK_S)
    try:
        yield
    finally:
        await cancel_tasks([task])
