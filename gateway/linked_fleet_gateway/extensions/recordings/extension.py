"""The extension ``recordings``: the last 30 s of a robot, kept when something went wrong."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from linked_fleet_gateway.extensions.history.files import MCAP
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.recordings.recorder import SEGMENT, Recorder
from linked_fleet_gateway.http.extension import Core, Extension, Mount


class RecordingsExtension(Extension):
    name = "recordings"
    uses = ("history",)
    in_robot = (SEGMENT,)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        history = core.optional_service(History)
        if history is None or not history.span_s:
            yield Mount()
            return
        recorder = Recorder(core.live, history, core.state_path / "recordings")
        async with recorder.running() as branch:
            yield Mount(branches=(branch,), formats={"mcap": ("MCAP", MCAP)})
