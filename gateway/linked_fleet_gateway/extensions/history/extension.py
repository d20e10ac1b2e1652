"""The extension ``history``: recent values of each robot, and of each measured property.

Short copies of known documents are filled in at once, other histories are rendered in a thread. They are sent at the
pace of the client, with links to adjacent pages.
"""

import asyncio
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from prometheus_client.metrics_core import Metric
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from linked_fleet_gateway.base.errors import Busy
from linked_fleet_gateway.base.settings import Section, setting, whole_number
from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.resources import (
    HISTORIES,
    SEGMENT,
    RecordedHistory,
    history_branches,
    list_branch,
    measured_paths,
)
from linked_fleet_gateway.extensions.history.span import parse_span
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.fields import Link, link_header
from linked_fleet_gateway.http.html import NavigationEntry
from linked_fleet_gateway.http.operations import (
    last_segment,
    parameter,
    rdf_get_operation,
    resource_path_items,
    segment_schema,
)
from linked_fleet_gateway.http.preconditions import check_preconditions
from linked_fleet_gateway.http.read import read_resource
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.serialise import TEXT_TYPES
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.runtime.metrics import gauge

_PIECE_BYTES = 64 * 1024
_LINK_BYTES = 512


async def read_history(request: Request, found: Resource, past: RecordedHistory) -> Response:
    """Return the requested part of a history, rendered in a thread. Raises BadRequest, Busy."""

    representations, accept = request.services.representations, request.effective_accept
    shown = past.select_page(parse_span(request.query_params.multi_items()))
    selected = shown.resource
    is_text = representations.choose_media_type(accept, selected) in TEXT_TYPES

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
    file = media_type in (CSV, MCAP)
    page, address = shown.file if file else shown.document, request.base + shown.resource.path
    leads = [Link(f"{address}?{query}", rel) for rel, query in (("next", page.next), ("prev", page.previous)) if query]
    if leads:
        response.headers.append("link", link_header(leads, [], limit=_LINK_BYTES))
    if len(response.body) <= _PIECE_BYTES:
        return response
    if past.history.files.locked():
        raise Busy("Too many histories are being sent; try again.")
    return _Pieces(response, past.history.files)


class _Pieces(Response):
    """A response sent at the pace of the client. It occupies a slot until then, because its bytes stay in memory."""

    def __init__(self, response: Response, slots: asyncio.Semaphore) -> None:
        self.status_code, self.raw_headers, self.body = response.status_code, response.raw_headers, response.body
        self.background = None
        self._slots = slots

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async with self._slots:
            await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
            for first in range(0, len(self.body), _PIECE_BYTES):
                piece = bytes(self.body[first : first + _PIECE_BYTES])
                more = first + _PIECE_BYTES < len(self.body)
                await send({"type": "http.response.body", "body": piece, "more_body": more})


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


class HistoryExtension(Extension):
    name = "history"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    shapes = (Path(__file__).with_name("shapes.ttl"),)
    at_root = ("history",)
    in_robot = ("history",)
    navigation = (NavigationEntry("History", HISTORIES, 40),)
    settings = HistorySettings

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.history import page

        return (page.LIST, page.HISTORY)

    def operations(self, view: RequestView) -> Mapping[str, Json]:
        return operations(view)

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


_TIME: Json = {"type": "string", "format": "date-time"}
_DURATION: Json = {"type": "string", "pattern": "^PT[0-9]{1,6}S$", "examples": ["PT10S"]}
_SPAN = [
    parameter("from", "query", _TIME, "The earliest time."),
    parameter("to", "query", _TIME, "The end of the span; samples at that time are excluded."),
    parameter("last", "query", _DURATION, "Length of the span up to the newest sample, instead of from and to."),
    parameter(
        "limit", "query", {"type": "integer", "minimum": 1, "maximum": 999_999_999}, "The maximum number of samples."
    ),
]


def operations(view: RequestView) -> dict[str, Json]:
    """Return the OpenAPI path items of the list of histories, and of histories of robots and measured properties."""
    robots = [each for each in view.robots.values() if each.model is not None]
    of = {"robot": segment_schema(last_segment(robot_path(each.name)) for each in robots)}
    paths = list[list[str]]()
    for each in robots:
        with view.faults.guard("OpenAPI", each.name, "its histories"):
            paths += [path.split("/")[2:] for path in measured_paths(each)]
    own, parts = [each for each in paths if len(each) == 1], [each for each in paths if len(each) == 2]
    whole = rdf_get_operation("readHistory", "Recent values of a robot", None, {"csv": CSV, "mcap": MCAP}, _SPAN)
    found = resource_path_items(HISTORIES, {}, "Histories", "The histories of all robots")
    if robots:
        found |= resource_path_items(f"/{{robot}}/{SEGMENT}", of, "History", "Recent values of a robot", whole)
    if own:
        get = rdf_get_operation("readOwnHistory", "Recent values of a property of a robot", None, {"csv": CSV}, _SPAN)
        template, parameters = (
            f"/{{robot}}/{{property}}/{SEGMENT}",
            of | {"property": segment_schema(each[0] for each in own)},
        )
        found |= resource_path_items(template, parameters, "OwnHistory", "History of a property of a robot", get)
    if parts:
        get = rdf_get_operation(
            "readPartHistory", "Recent values of a property of a joint or link", None, {"csv": CSV}, _SPAN
        )
        parameters = of | {
            "part": segment_schema(each[0] for each in parts),
            "property": segment_schema(each[1] for each in parts),
        }
        template = f"/{{robot}}/{{part}}/{{property}}/{SEGMENT}"
        found |= resource_path_items(template, parameters, "PartHistory", "History of a property of a part", get)
    return found
