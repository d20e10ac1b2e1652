"""The extension ``reach``: inverse kinematics as the action ``reach``, and as a function of queries."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from linked_fleet_gateway.extensions.reach.handler import reach
from linked_fleet_gateway.extensions.reach.terms import LF
from linked_fleet_gateway.http.extension import Core, Extension, Mount


class ReachExtension(Extension):
    name = "reach"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    kinds = (Path(__file__).with_name("reach.ttl"),)
    functions = ("linked_fleet_gateway.extensions.reach.can_reach:CanReach",)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        yield Mount(handlers={LF.Reach: reach})
