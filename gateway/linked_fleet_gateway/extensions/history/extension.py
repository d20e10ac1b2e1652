"""The extension ``history``: recent values of each robot, and of each measured property."""

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

from prometheus_client.metrics_core import Metric

from linked_fleet_gateway.extensions.history.http import read_history
from linked_fleet_gateway.extensions.history.listing import HISTORIES, list_branch
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.resources import RecordedHistory, history_branches
from linked_fleet_gateway.extensions.history.settings import HistorySettings
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.html import NavigationEntry
from linked_fleet_gateway.runtime.metrics import gauge


class HistoryExtension(Extension):
    name = "history"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    at_root = ("history",)
    in_robot = ("history",)
    views = (
        "linked_fleet_gateway.extensions.history.page:LIST",
        "linked_fleet_gateway.extensions.history.page:HISTORY",
    )
    navigation = (NavigationEntry("History", HISTORIES, 40),)
    operations = ("linked_fleet_gateway.extensions.history.operations:operations",)
    settings = HistorySettings

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        settings = core.section(HistorySettings)
        async with History(core.live.fleet, float(settings.s), float(settings.hz), settings.mb * 10**6) as history:
            yield Mount(
                branches=(list_branch(history), *(history_branches(history) if settings.s else ())),
                readers={RecordedHistory: read_history},
                formats={"csv": ("CSV", "text/csv"), "mcap": ("MCAP", "application/vnd.mcap")},
                services=(history,),
                metrics=lambda: _metrics(history),
            )


def _metrics(history: History) -> Iterator[Metric]:
    yield gauge("history_bytes", "Memory of the histories of all robots.", history.bytes)
    yield gauge("history_samples", "Samples in the histories of all robots.", history.samples)
