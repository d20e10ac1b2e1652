"""The extension ``recordings``: the last 30 s of a robot, kept as MCAP when something has gone wrong."""

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

from linked_fleet_gateway.api import Core, Extension, Mount
from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.recordings.recorder import SEGMENT, Recorder
from linked_fleet_gateway.extensions.recordings.resources import recordings_branch
from linked_fleet_gateway.extensions.world.service import World


class RecordingsExtension(Extension):
    """Recordings at ``/{robot}/recordings``."""

    name = "recordings"
    uses = ("history", "world")
    in_robot = (SEGMENT,)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.recordings import page

        return page.VIEWS

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        history = core.optional_service(History)
        if history is None or not history.span_s:
            yield Mount()
            return
        recorder = Recorder(core, history, core.optional_service(World), core.state_path / "recordings")
        async with recorder.running():
            yield Mount(
                branches=(recordings_branch(recorder),),
                formats={"csv": ("CSV", CSV), "mcap": ("MCAP", MCAP)},
                services=(recorder,),
            )
