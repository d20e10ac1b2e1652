"""The state of the check process, and its answers to questions. Importing it loads Pinocchio and Coal."""

import logging
from collections import OrderedDict
from pathlib import Path
from typing import Self

import coal

from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.map_obstacles import MapObstacles
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CheckFailed,
    MeshesMissing,
    Prepare,
    PrepareMap,
    PrepareMesh,
    Question,
    Ready,
    Survey,
)
from linked_fleet_gateway.extensions.world.path import UnknownPosition
from linked_fleet_gateway.extensions.world.plane import on_plane
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.shapes import (
    build_object_shape,
    build_robot,
    build_unchecked_robot,
    needed_meshes,
)
from linked_fleet_gateway.extensions.world.surfaces import MeshCache, Surface, read_mesh
from linked_fleet_gateway.extensions.world.survey import survey
from linked_fleet_state.xml import ModelError

_log = logging.getLogger(__name__)

MOST_TRIANGLES_HELD = 2_000_000
"""Bound of the meshes kept for robots that may still be prepared: about 100 MB."""


class Worker:
    """The state of the process that checks motions: prepared shapes, and the answers to its questions."""

    @classmethod
    def caching_in(cls, folder: Path | None) -> Self:
        """Return a worker that caches meshes in ``folder``; None means that it caches none."""
        return cls(MeshCache(folder))

    def __init__(self, cache: MeshCache, most_triangles: int = MOST_TRIANGLES_HELD) -> None:
        self._cache, self._most_triangles = cache, most_triangles
        self._robots: dict[str, Robot] = {}
        self._objects: dict[str, coal.CollisionGeometry] = {}
        self._maps: dict[str, MapObstacles] = {}
        self._meshes: OrderedDict[str, Surface] = OrderedDict()

    def answer(self, question: Question) -> Answer:
        try:
            if isinstance(question, Check):
                return check(question, self._robots, self._objects, self._maps)
            if isinstance(question, Survey):
                return survey(question, self._robots, self._objects)
            if isinstance(question, Prepare):
                return self._prepare(question)
            if isinstance(question, PrepareMesh):
                surface = read_mesh(question.name.rpartition(".")[2], question.content)
                self._cache.put(question.name, surface)
                self._hold(question.name, surface)
            elif isinstance(question, PrepareMap):
                self._maps = {question.key: MapObstacles(question)}  # a fleet has one map at a time
            else:
                self._objects[question.key] = build_object_shape(question.geometry)
        except UnknownPosition as error:
            return CheckFailed(str(error))
        except (ModelError, MemoryError, RuntimeError) as error:
            return CheckFailed(str(error) or "it takes too much memory")
        except Exception:  # noqa: BLE001 - of a library, in data of a robot or client: the process serves the others
            _log.exception("a question to the process that checks motions failed")
            return CheckFailed("the check of it failed by an error, which the log of the gateway has")
        return Ready()

    def _prepare(self, asked: Prepare) -> Answer:
        urdf = on_plane(asked.urdf) if asked.drives else asked.urdf
        if asked.unusable_robot:
            return self._ready(asked.key, build_unchecked_robot(urdf, asked.unusable_robot))
        usable = {uri for uri, name in asked.meshes.items() if name not in asked.unusable}
        names = {uri: asked.meshes[uri] for uri in needed_meshes(asked.urdf, usable)}
        found = {name: self._mesh(name) for name in set(names.values())}
        if lacking := sorted(name for name, surface in found.items() if surface is None):
            return MeshesMissing(tuple(lacking))
        surfaces = {uri: surface for uri, name in names.items() if (surface := found[name]) is not None}

        def surface_of(uri: str) -> Surface:
            if uri not in surfaces:
                raise ModelError(asked.unusable.get(asked.meshes[uri], "it was not loaded"))
            return surfaces[uri]

        return self._ready(asked.key, build_robot(urdf, asked.meshes.keys(), surface_of))

    def _ready(self, key: str, robot: Robot) -> Ready:
        self._robots[key] = robot
        return Ready(robot.unchecked, robot.whole_m)

    def _mesh(self, name: str) -> Surface | None:
        if (held := self._meshes.get(name)) is not None:
            self._meshes.move_to_end(name)
            return held
        found = self._cache.get(name)
        if found is not None:
            self._hold(name, found)
        return found

    def _hold(self, name: str, surface: Surface) -> None:
        self._meshes[name] = surface
        while sum(len(each.triangles) for each in self._meshes.values()) > self._most_triangles:
            self._meshes.popitem(last=False)
