"""The extension ``navigation``: bases drive to a place on a way that is found, and give way to each other."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec

from linked_fleet_gateway.api import Core, Extension, Mount
from linked_fleet_gateway.extensions.navigation.drive_to import LF, DriveTo, drives_of
from linked_fleet_gateway.extensions.navigation.messages import EDGE, MAP, Answer, PlanFailed, PlanWay
from linked_fleet_gateway.extensions.navigation.other_gateways import Notice
from linked_fleet_gateway.extensions.navigation.traffic import Traffic
from linked_fleet_gateway.extensions.world.descriptions import OBJECTS
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.serving import NoReply, QuestionProcess

PLAN_S = 5.0
"""The longest that a plan may take, with the start of its process."""
PLANNER = "linked_fleet_gateway.extensions.navigation.planning_process"


class NavigationExtension(Extension):
    name = "navigation"
    needs = ("world",)
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    kinds = (Path(__file__).with_name("drive_to.ttl"),)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        world = core.service(World)
        process = QuestionProcess[PlanWay, Answer](PLANNER, msgspec.msgpack.Decoder(Answer))

        async def plan(asked: PlanWay) -> Answer:
            try:
                return await process.ask(asked, PLAN_S)
            except NoReply:
                return PlanFailed("the planner gave no answer in time")

        def is_driven(name: str) -> bool:
            return bool(name) and bool(drives_of(core, name))

        def title(name: str) -> str:
            if name == MAP:
                return "the map of the floor" if world.floor is None else world.floor.title
            if name == EDGE:
                return "the edge of the corridor"
            if name.startswith(OBJECTS + "/"):
                thing = world.objects.known.get(name.removeprefix(OBJECTS + "/"))
                return "an object that is gone" if thing is None else thing.title
            return name or "another robot"

        board = core.table("drives", Notice, lambda id, before, after: traffic.tell())
        traffic = Traffic(plan, is_driven, title, board)
        drive = DriveTo(core, world, traffic).plan
        try:
            async with board:
                yield Mount(handlers={LF.DriveTo: drive, LF.DriveNear: drive})
        finally:
            await process.end()
