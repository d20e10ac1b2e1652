"""The extension ``reach``: inverse kinematics as the action ``reach``, and as a function of queries."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from linked_fleet_gateway.extensions.reach.handler import reach
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.rdf.vocabulary import LF


class ReachExtension(Extension):
    name = "reach"
    kinds = (Path(__file__).with_name("reach.ttl"),)
    functions = ("linked_fleet_gateway.extensions.reach.can_reach:CanReach",)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        yield Mount(handlers={LF.Reach: reach})
