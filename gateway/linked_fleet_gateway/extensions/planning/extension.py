"""The extension ``planning``: motions of joints on paths that are found, round what is in the way."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from linked_fleet_gateway.api import Core, Extension, Mount
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.planning.planner import Planner
from linked_fleet_gateway.extensions.world.service import World


class PlanningExtension(Extension):
    name = "planning"
    needs = ("models", "world", "reach")
    modules = ("roboplan",)
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    kinds = (Path(__file__).with_name("path.ttl"),)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        planner = Planner(core, core.service(World), core.service(Meshes), core.state_path / "meshes")
        try:
            yield Mount(planner=planner)
        finally:
            await planner.close()
