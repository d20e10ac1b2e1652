"""The world: its resources in the tree, its objects, and the checks of motions.

All gateways share the objects through Redis; each has a copy of them.
"""

from collections.abc import Iterator, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

from pyoxigraph import Triple

from linked_fleet_gateway.api import FleetBranch, Found, RequestView, Table
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collisions
from linked_fleet_gateway.extensions.world.descriptions import OBJECTS, describe_frame, describe_objects, object_path
from linked_fleet_gateway.extensions.world.placement import LF, WORLD
from linked_fleet_gateway.extensions.world.resources import resolve_world
from linked_fleet_gateway.extensions.world.scene import MAX_OBJECTS, SceneObject, decode, encode
from linked_fleet_gateway.fleet.kinematics import ORIGIN
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.serving import Live, StoredRecords

NOUN = "objects in the world"


def stored_objects(url: str, namespace: str) -> StoredRecords:
    """Return the access to the objects in Redis."""
    return StoredRecords(url, namespace, "world", "objects", MAX_OBJECTS)


class World:
    """An async context manager; meshes are cached in ``folder``."""

    def __init__(self, live: Live, meshes: Meshes, url: str, namespace: str, folder: Path) -> None:
        self._live = live
        stored = stored_objects(url, namespace)
        self.objects = Table(stored, NOUN, encode, decode, self._changed, live.faults)
        self._described: tuple[tuple[str, int], Sequence[Triple]] = (("", 0), ())
        self.collisions = Collisions(live.fan_out.mark_changed)
        self.checks = Checks(live, meshes, self.objects.known, folder, self.collisions)
        self._stack = AsyncExitStack()

    @property
    def branch(self) -> FleetBranch:
        objects, collisions = self.objects.known, self.collisions.known

        def resolve(view: RequestView, rest: list[str]) -> Found:
            return resolve_world(view, rest, objects, collisions)

        return FleetBranch(WORLD[1:], LF.world, resolve, graphs=self.triples, poses=self.poses)

    def _changed(self, id: str, before: SceneObject | None, after: SceneObject | None) -> None:
        if before is None:
            self._live.fan_out.add_resource(object_path(id))
        self._live.fan_out.mark_changed(object_path(id), OBJECTS)

    def poses(self) -> dict[str, Pose]:
        """Poses of the frame itself and of the objects in it, by path."""
        return {WORLD: ORIGIN} | {object_path(id): each.pose for id, each in self.objects.known.items()}

    def triples(self, view: RequestView) -> Iterator[tuple[str, Sequence[Triple]]]:
        """Yield all statements about the world, for copies of the fleet. Placements are described with their robots."""
        frame, key, known = Graph(), (view.base, self.objects.changes), self.objects.known
        describe_frame(frame, view.base, view.robots.values())
        yield WORLD, frame.triples
        if self._described[0] != key:
            objects = Graph()
            describe_objects(objects, view.base, known, len(known))
            self._described = key, objects.triples
        yield OBJECTS, self._described[1]

    async def __aenter__(self) -> Self:
        await self._stack.enter_async_context(self.objects)
        await self._stack.enter_async_context(self.checks)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()
