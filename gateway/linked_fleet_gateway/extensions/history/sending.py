"""Sending of histories: with links to adjacent pages, and long ones at the pace of the client, a few at a time."""

import asyncio
from collections.abc import Mapping

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from linked_fleet_base.errors import Busy
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.serving import WebLink, link_header

_PIECE_BYTES = 64 * 1024
_LINK_BYTES = 512


def paced(response: Response, history: History, address: str, queries: Mapping[str, str]) -> Response:
    """Return the response with links to other pages at ``address``, by their queries; sent in pieces if it is long.

    Raises Busy if too many long ones are being sent.
    """
    leads = [WebLink(f"{address}?{query}", relation) for relation, query in queries.items() if query]
    if leads:
        response.headers.append("link", link_header(leads, [], limit=_LINK_BYTES))
    if len(response.body) <= _PIECE_BYTES:
        return response
    if history.files.locked():
        raise Busy("Too many histories are being sent; try again.")
    return _Pieces(response, history.files)


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
