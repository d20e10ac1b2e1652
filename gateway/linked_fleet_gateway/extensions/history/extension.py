"""The extension ``history``: recent values of each robot, and of each measured property.

Short copies of known documents are filled in at once, other histories are rendered in a thread. They are sent at the
pace of the client, with links to adjacent pages.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from prometheus_client.metrics_core import Metric
from starlette.responses import Response

from linked_fleet_base.settings import Section, setting, whole_number
from linked_fleet_gateway.api import (
    Core,
    Extension,
    Mount,
    NavigationEntry,
    Request,
    RequestView,
    Resource,
    counter,
    gauge,
    read_resource,
)
from linked_fleet_gateway.extensions.history.archive import Archive
from linked_fleet_gateway.extensions.history.component_values import watching_values
from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.listing import HISTORIES, list_branch
from linked_fleet_gateway.extensions.history.operations import operations
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.resources import RecordedHistory, history_branches
from linked_fleet_gateway.extensions.history.sending import paced
from linked_fleet_gateway.extensions.history.span import parse_span
from linked_fleet_gateway.extensions.history.values import RecordedValues, read_values
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.serving import check_preconditions
from linked_fleet_rdf.serialise import TEXT_TYPES


async def read_history(request: Request, found: Resource, past: RecordedHistory) -> Response:
    """Return the requested part of a history, rendered in a thread. Raises BadRequest, Busy."""

    representations, accept = request.services.representations, request.effective_accept
    shown = past.select_page(parse_span(request.query_params.multi_items()))
    chosen = representations.choose_media_type(accept, shown.resource)
    is_text = chosen in TEXT_TYPES
    if (on_disk := shown.on_disk) is not None:
        async with past.history.worker():
            shown = await asyncio.to_thread(on_disk, chosen in (CSV, MCAP))
    selected = shown.resource

    def templated() -> Resource:
        template = shown.template() if is_text else None
        return selected if template is None else selected.replace(describe=template)

    def work(resource: Resource) -> Response:
        check_preconditions(request, resource)
        return read_resource(request, resource)

    if is_text and shown.is_short and representations.is_quick(accept, known := templated(), request.base):
        response = work(known)
    else:
        async with past.history.worker():
            response = await asyncio.to_thread(lambda: work(templated()))
    media_type = response.headers.get("content-type", "").partition(";")[0]
    page = shown.file if media_type in (CSV, MCAP) else shown.document
    queries = {"next": page.next, "prev": page.previous}
    return paced(response, past.history, request.base + shown.resource.path, queries)


@dataclass(frozen=True)
class HistorySettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_HISTORY_"

    s: int = setting(whole_number(0, 86_400), "300", "seconds to keep of each robot; 0: none")
    hz: int = setting(
        whole_number(1, 100),
        "10",
        "samples a second to keep of each robot, at most 100",
    )
    mb: int = setting(
        whole_number(1, 1_000_000),
        "24",
        "memory (MB) of all histories; when it is full, older samples are thinned out",
    )
    disk_hours: int = setting(
        whole_number(0, 8784), "48", "hours to keep on disk, in the state folder; 0: nothing is written"
    )
    disk_mb: int = setting(
        whole_number(10, 100_000_000), "4000", "MB to keep on disk at most; the oldest hours are removed"
    )
    disk_hz: int = setting(
        whole_number(1, 100),
        "2",
        "samples a second to keep on disk of each robot that moves",
    )


class HistoryExtension(Extension):
    name = "history"
    needs = ("models",)
    uses = ("components", "world")
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    at_root = ("history",)
    in_robot = ("history",)
    navigation = (NavigationEntry("History", HISTORIES, 40),)
    settings = HistorySettings

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.history import page

        return (page.LIST, page.HISTORY)

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        settings, world = core.section(HistorySettings), core.optional_service(World)
        archive = _archive(core, settings)
        async with AsyncExitStack() as stack:
            if archive is not None:
                await stack.enter_async_context(archive.running())
                await stack.enter_async_context(watching_values(core, archive))
                stack.enter_context(core.listening_to_descriptions(lambda robot: None, archive.forget))
            most = settings.mb * 10**6
            history = History(core.live.fleet, float(settings.s), float(settings.hz), most, archive, core.faults)
            await stack.enter_async_context(history)
            yield Mount(
                branches=(list_branch(history), *(history_branches(history, world) if settings.s else ())),
                readers={RecordedHistory: read_history, RecordedValues: read_values},
                formats={"csv": ("CSV", "text/csv"), "mcap": ("MCAP", "application/vnd.mcap")},
                services=(history,),
                metrics=lambda: _metrics(history),
            )


def _archive(core: Core, settings: HistorySettings) -> Archive | None:
    if not settings.s or not settings.disk_hours:
        return None

    def failed(error: Exception | None) -> None:
        """Say in the health of the gateway that nothing is written, or no longer."""
        with core.faults.guard("History", thing="writing to disk"):
            if error is not None:
                raise error

    loop = asyncio.get_running_loop()
    rate_hz = float(min(settings.disk_hz, settings.hz))
    return Archive(
        core.state_path / "history",
        settings.disk_hours * 3600.0,
        settings.disk_mb * 10**6,
        rate_hz,
        lambda error: _in_loop(loop, partial(failed, error)),
    )


def _in_loop(loop: asyncio.AbstractEventLoop, call: Callable[[], None]) -> None:
    with suppress(RuntimeError):  # the gateway has ended
        loop.call_soon_threadsafe(call)


def _metrics(history: History) -> Iterator[Metric]:
    yield gauge("history_bytes", "Memory of the histories of all robots.", history.bytes)
    yield gauge("history_samples", "Samples in the histories of all robots.", history.samples)
    if (archive := history.archive) is not None:
        damaged = len(archive.shelf.damaged)
        yield gauge("history_disk_bytes", "Size of the histories on disk.", archive.bytes)
        yield gauge("history_disk_segments", "Files of the histories on disk.", archive.shelf.count)
        yield gauge("history_disk_damaged", "Files of the histories on disk that cannot be read.", damaged)
        yield counter("history_disk_lost", "Samples that could not be written to disk.", archive.lost)
