"""The extension ``models``: the URDF of each robot, and its meshes, asked of its agent and kept in memory.

Both are also served with fewer triangles, for small screens and for scenes of many robots.
"""

from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager, closing
from functools import partial
from pathlib import Path

from linked_fleet_gateway.api import Core, Extension, Mount
from linked_fleet_gateway.extensions.models.geometry import MESHES, MODEL
from linked_fleet_gateway.extensions.models.meshes import Meshes, ask
from linked_fleet_gateway.extensions.models.resources import (
    BRANCHES,
    RemoteMesh,
    SimplifiedMesh,
    read_mesh,
    read_simplified_mesh,
)
from linked_fleet_gateway.extensions.models.simplified import SimplifiedMeshes


class ModelsExtension(Extension):
    name = "models"
    in_robot = (MODEL, MESHES)
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        with closing(Meshes(partial(ask, core.live))) as meshes:
            async with aclosing(SimplifiedMeshes(meshes)) as simplified:
                yield Mount(
                    branches=BRANCHES,
                    readers={
                        RemoteMesh: partial(read_mesh, meshes),
                        SimplifiedMesh: partial(read_simplified_mesh, simplified),
                    },
                    services=(meshes,),
                )
