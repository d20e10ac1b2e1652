"""Reads of histories: rendered in a thread, sent at the pace of the client, with links to adjacent pages."""

import asyncio
from dataclasses import replace

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from linked_fleet_gateway.base.errors import Busy
from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.resources import RecordedHistory
from linked_fleet_gateway.extensions.history.span import parse_span
from linked_fleet_gateway.http.links import Link, link_header
from linked_fleet_gateway.http.preconditions import check_preconditions
from linked_fleet_gateway.http.read import read
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.resource import Resource

_PIECE_BYTES = 64 * 1024
_LINK_BYTES = 512
_SUFFIXES = {CSV: "csv", MCAP: "mcap"}


async def read_history(request: Request, found: Resource, past: RecordedHistory) -> Response:
    """Return the requested part of a history, rendered in a thread. Raises BadRequest, Busy."""

    def work(resource: Resource) -> Response:
        check_preconditions(request, resource)
        return read(request, resource)

    shown = past.shown(parse_span(request.query_params.multi_items()))
    async with past.history.workers:
        response = await asyncio.to_thread(work, replace(shown.resource.read_as(found), query=request.url.query))
    media_type = response.headers.get("content-type", "").partition(";")[0]
    file = media_type in _SUFFIXES
    page, address = shown.file if file else shown.document, request.base + shown.resource.path
    leads = [Link(f"{address}?{query}", rel) for rel, query in (("next", page.next), ("prev", page.previous)) if query]
    if leads:
        response.headers.append("link", link_header(leads, [], limit=_LINK_BYTES))
    if file:
        name = shown.resource.path[1:].replace("/", "-")  # contains nothing that would need quoting
        response.headers["content-disposition"] = f'attachment; filename="{name}.{_SUFFIXES[media_type]}"'
    if len(response.body) <= _PIECE_BYTES:
        return response
    if past.history.files.locked():
        raise Busy("Too many histories are being sent; ask again.")
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
