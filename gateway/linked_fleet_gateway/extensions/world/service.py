"""The world: its resources in the tree, its objects, and the checks of motions.

All gateways share the objects and the map of the floor through Redis; each has a copy of them.
"""

import asyncio
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from pyoxigraph import Triple

from linked_fleet_gateway.api import Core, FleetBranch, Found, RequestView, Table
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world import floor_map
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collisions
from linked_fleet_gateway.extensions.world.descriptions import OBJECTS, describe_frame, describe_objects, object_path
from linked_fleet_gateway.extensions.world.floor_map import ID, MAX_STORED_BYTES, FloorMap
from linked_fleet_gateway.extensions.world.held import path_of
from linked_fleet_gateway.extensions.world.holding import Holding
from linked_fleet_gateway.extensions.world.map_resources import MAP, describe_map
from linked_fleet_gateway.extensions.world.messages import Surveyed
from linked_fleet_gateway.extensions.world.placement import LF, WORLD
from linked_fleet_gateway.extensions.world.resources import resolve_world
from linked_fleet_gateway.extensions.world.scene import MAX_OBJECTS, SceneObject, decode, encode
from linked_fleet_gateway.faces import View
from linked_fleet_gateway.serving import StoredRecords
from linked_fleet_rdf.graph import Graph
from linked_fleet_state.carried import CarriedPose
from linked_fleet_state.kinematics import ORIGIN
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.world.occupancy import OccupancyGrid

NOUN, NOUN_OF_MAPS = "objects in the world", "maps of the floor"
_MAX_MAP_BYTES = 3 * MAX_STORED_BYTES


def stored_objects(url: str, namespace: str) -> StoredRecords:
    """Return the access to the objects in Redis."""
    return StoredRecords(url, namespace, "world", "objects", MAX_OBJECTS)


def stored_maps(url: str, namespace: str) -> StoredRecords:
    """Return the access to the map of the floor in Redis, the only record of its table."""
    return StoredRecords(url, namespace, "world", "maps", 1, _MAX_MAP_BYTES)


class World:
    """An async context manager; meshes are cached in ``folder``."""

    def __init__(self, core: Core, meshes: Meshes, folder: Path) -> None:
        live = self._live = core.live
        stored = stored_objects(core.redis_url, core.namespace)
        self.objects = Table(stored, NOUN, encode, decode, self._changed, live.faults)
        maps = stored_maps(core.redis_url, core.namespace)
        self.maps = Table(maps, NOUN_OF_MAPS, floor_map.encode, floor_map.decode, self._map_changed, live.faults)
        for table in (self.objects, self.maps):
            core.add_copy(table.noun, table)
        self.collisions = Collisions(live.fan_out.mark_changed)
        self._holding = Holding(live, self.objects)
        settled, known = self._holding.wait_until_settled, self.objects.known
        self.objects.on_unreadable = lambda id: live.fan_out.mark_changed(object_path(id), OBJECTS)
        self.maps.on_unreadable = lambda id: live.fan_out.mark_changed(MAP)
        self.checks = Checks(
            live, meshes, known, folder, self.collisions,
            maps=self.maps.known, settled=settled, unreadable=self.unreadable,
        )  # fmt: skip
        self._described: tuple[tuple[str, int, tuple[str, ...]], Sequence[Triple]] = (("", 0, ()), ())
        self._grid: tuple[FloorMap, OccupancyGrid] | None = None
        self._stack = AsyncExitStack()

    @property
    def branch(self) -> FleetBranch:
        objects, collisions, maps = self.objects.known, self.collisions.known, self.maps.known

        def resolve(view: RequestView, rest: list[str]) -> Found:
            return resolve_world(view, rest, objects, collisions, maps, self.unreadable)

        return FleetBranch(WORLD[1:], LF.world, resolve, graphs=self.triples, poses=self.poses)

    def unreadable(self) -> list[str]:
        """Return the paths of objects, and of the map, whose records cannot be read: nothing moves among them."""
        return [*map(object_path, self.objects.unreadable), *(MAP for _ in self.maps.unreadable)]

    def _changed(self, id: str, before: SceneObject | None, after: SceneObject | None) -> None:
        if before is None:
            self._live.fan_out.add_resource(object_path(id))
        self._live.fan_out.mark_changed(object_path(id), OBJECTS)

    def _map_changed(self, id: str, before: FloorMap | None, after: FloorMap | None) -> None:
        self._live.fan_out.mark_changed(MAP)

    def mark_held_changed(self, robot: str) -> None:
        """Tell that the links of a robot, in whose frames what it holds is, have become known or unknown."""
        ids = [id for id, each in self.objects.known.items() if each.held is not None and each.held.robot == robot]
        if ids:
            self._live.fan_out.mark_changed(*map(object_path, ids), OBJECTS)

    def holder_of(self, path: str) -> str:
        """Return the name of the robot that holds the object at a path; empty for none."""
        thing = self.objects.known.get(path.removeprefix(OBJECTS + "/"))
        return "" if thing is None or thing.held is None else thing.held.robot

    async def occupancy(self) -> "OccupancyGrid | None":
        """Return the cells of the map of the floor; None without one. Unpacked in a thread once for each map."""
        found = self.maps.known.get(ID)
        if found is None:
            self._grid = None
        elif self._grid is None or self._grid[0] is not found:
            self._grid = found, await asyncio.to_thread(_grid_of, found)
        return None if self._grid is None else self._grid[1]

    @property
    def floor(self) -> FloorMap | None:
        """The map of the floor."""
        return self.maps.known.get(ID)

    async def survey(self, robot: Robot, sees: View) -> Surveyed:
        """Return what stands on the floor around a robot with a placement. Raises Unchecked, Busy."""
        return await self.checks.survey(robot, sees)

    @property
    def robots(self) -> Mapping[str, Robot]:
        """All robots by name."""
        return self._live.fleet.robots

    def poses(self) -> dict[str, Pose | CarriedPose]:
        """Poses of the frame itself, and of the objects in it or on the links that hold them, by path."""
        objects: dict[str, Pose | CarriedPose] = {
            object_path(id): each.pose if (by := each.held) is None else CarriedPose(by.robot, by.link, by.pose)
            for id, each in self.objects.known.items()
        }
        return {WORLD: ORIGIN} | objects

    def triples(self, view: RequestView) -> Iterator[tuple[str, Sequence[Triple]]]:
        """Yield all statements about the world, for copies of the fleet. Placements are described with their robots."""
        frame, known = Graph(), self.objects.known
        holders = tuple(path_of(each.held, view.robots) for each in known.values() if each.held is not None)
        key = view.base, self.objects.changes, holders
        describe_frame(frame, view.base, view.robots.values())
        yield WORLD, frame.triples
        if self._described[0] != key:
            objects = Graph()
            describe_objects(objects, view.base, known, view.robots, len(known))
            self._described = key, objects.triples
        yield OBJECTS, self._described[1]
        floor = Graph()
        describe_map(floor, view.base, self.maps.known.get(ID))
        yield MAP, floor.triples

    async def __aenter__(self) -> Self:
        await self._stack.enter_async_context(self.objects)
        await self._stack.enter_async_context(self._holding)
        await self._stack.enter_async_context(self.maps)
        await self._stack.enter_async_context(self.checks)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()


def _grid_of(found: FloorMap) -> "OccupancyGrid":
    from linked_fleet_gateway.extensions.world.map_image import grid_of  # with numpy, which only maps need

    return grid_of(found)
