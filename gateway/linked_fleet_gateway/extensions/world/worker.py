"""The check process: questions on standard input, answers on standard output, until the input ends.

It parses data of robots and clients with libraries that were not made for untrusted input. So it has no secrets, no
network connections and a memory limit, and may be killed at any time. Its argument is the folder of the mesh cache.
"""

import logging
import resource
import struct
import sys
from collections import OrderedDict
from pathlib import Path
from typing import BinaryIO

import coal
import msgspec

from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.mesh_cache import MeshCache
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CheckFailed,
    MeshesMissing,
    Prepare,
    PrepareMesh,
    Question,
    Ready,
)
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.shapes import meshes_needed, object_of, robot_of
from linked_fleet_gateway.extensions.world.surfaces import Surface, read_mesh
from linked_fleet_gateway.fleet.xml import ModelError

MAX_MEMORY_BYTES = 4 * 2**30
LENGTH = struct.Struct("<I")
MOST_TRIANGLES_HELD = 2_000_000
"""Bound of the meshes kept for robots that may still be prepared: about 100 MB."""


class Worker:
    """The state of the process that checks motions: prepared shapes, and the answers to its questions."""

    def __init__(self, cache: MeshCache, most_triangles: int = MOST_TRIANGLES_HELD) -> None:
        self._cache, self._most_triangles = cache, most_triangles
        self._robots: dict[str, Robot] = {}
        self._objects: dict[str, coal.CollisionGeometry] = {}
        self._meshes: OrderedDict[str, Surface] = OrderedDict()

    def answer(self, question: Question) -> Answer:
        if isinstance(question, Check):
            return check(question, self._robots, self._objects)
        try:
            if isinstance(question, Prepare):
                return self._prepare(question)
            if isinstance(question, PrepareMesh):
                surface = read_mesh(question.name.rpartition(".")[2], question.content)
                self._cache.put(question.name, surface)
                self._hold(question.name, surface)
            else:
                self._objects[question.key] = object_of(question.geometry)
        except (ModelError, MemoryError, RuntimeError) as error:
            return CheckFailed(f"its shape cannot be used: {error}")
        return Ready()

    def _prepare(self, asked: Prepare) -> Answer:
        names = {uri: asked.meshes[uri] for uri in meshes_needed(asked.urdf, asked.meshes.keys())}
        found = {name: self._mesh(name) for name in set(names.values())}
        if lacking := sorted(name for name, surface in found.items() if surface is None):
            return MeshesMissing(tuple(lacking))
        surfaces = {uri: surface for uri, name in names.items() if (surface := found[name]) is not None}
        self._robots[asked.key] = robot_of(asked.urdf, asked.meshes.keys(), surfaces.__getitem__)
        return Ready()

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


def main() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s %(message)s")
    decoder, encode = msgspec.msgpack.Decoder(Question), msgspec.msgpack.encode
    worker = Worker(MeshCache(Path(sys.argv[1]) if len(sys.argv) > 1 else None))
    stdin, stdout = sys.stdin.buffer, sys.stdout.buffer
    while head := stdin.read(LENGTH.size):
        answer = encode(worker.answer(decoder.decode(_read(stdin, head))))
        stdout.write(LENGTH.pack(len(answer)) + answer)
        stdout.flush()


def _read(stdin: BinaryIO, head: bytes) -> bytes:
    return stdin.read(LENGTH.unpack(head)[0])


if __name__ == "__main__":
    main()
