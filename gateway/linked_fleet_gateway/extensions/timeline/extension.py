"""The extension ``timeline``: what happened in the fleet, what happens and what is planned, by robot."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from linked_fleet_gateway.api import Core, Extension, Mount, NavigationEntry, RequestView
from linked_fleet_gateway.extensions.faults.extension import KnownFaults
from linked_fleet_gateway.extensions.missions.extension import RunsOfMissions
from linked_fleet_gateway.extensions.notes.extension import KnownNotes
from linked_fleet_gateway.extensions.queue.planned import PlannedWork
from linked_fleet_gateway.extensions.timeline.collecting import Collector
from linked_fleet_gateway.extensions.timeline.describing import PATH
from linked_fleet_gateway.extensions.timeline.operations import operations
from linked_fleet_gateway.extensions.timeline.resources import CSV, Timeline, read_timeline, timeline_branch

HERE = Path(__file__).parent


class TimelineExtension(Extension):
    """The timeline at ``/timeline``."""

    name = "timeline"
    at_root = (PATH[1:],)
    uses = ("missions", "faults", "queue", "notes")
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    navigation = (NavigationEntry("Timeline", PATH, 35),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.timeline import page

        return (page.VIEW,)

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        optional = core.optional_service
        collector = Collector(
            optional(RunsOfMissions), optional(KnownFaults), optional(PlannedWork), optional(KnownNotes)
        )
        yield Mount(
            branches=(timeline_branch(collector),),
            readers={Timeline: read_timeline},
            formats={"csv": ("CSV", CSV)},
        )
