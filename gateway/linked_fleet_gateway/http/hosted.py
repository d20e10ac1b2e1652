"""Requests that an ASGI application of another package answers, such as a protocol's SDK."""

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from http import HTTPStatus

from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from linked_fleet_server.protocol import HTTP, HttpProtocol


class AsgiResponse:
    """A response by ``app``. The body was read before, within limits. A stream ends with the gateway.

    ``extensions`` are added to those of the scope. ``on_end`` is called first when the gateway ends.
    """

    def __init__(
        self,
        app: ASGIApp,
        content: bytes,
        extensions: Mapping[str, object],
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        self._app, self._extensions, self._on_end = app, extensions, on_end
        self._content: bytes | None = content
        self._over = asyncio.Event()
        self._started = self._complete = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        http: HttpProtocol = scope["extensions"][HTTP]
        http.on_shutdown = self._end
        # A client that was killed closes its side only. Its protocol may demand that this cancels the request.
        http.stop_on_half_close = True
        if http.is_shutting_down:
            self._end()
        try:
            within = {**scope, "extensions": {**scope["extensions"], **self._extensions}}
            await self._app(within, partial(self._hear, receive), partial(self._say, send))
        finally:
            http.on_shutdown = None
            http.stop_on_half_close = False
        if not self._started:
            await Response(status_code=HTTPStatus.SERVICE_UNAVAILABLE)(scope, receive, send)
        elif not self._complete:
            await send({"type": "http.response.body", "body": b"", "more_body": False})

    def _end(self) -> None:
        self._on_end()
        self._over.set()

    async def _hear(self, receive: Receive) -> Message:
        """Return the body, and then the end by the client or the gateway."""
        if self._content is not None:
            content, self._content = self._content, None
            return {"type": "http.request", "body": content, "more_body": False}
        ends = [asyncio.ensure_future(each) for each in (_gone(receive), self._over.wait())]
        try:
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for each in ends:
                each.cancel()
        return {"type": "http.disconnect"}

    async def _say(self, send: Send, message: Message) -> None:
        if message["type"] == "http.response.start":
            self._started = True
            # The server decides if a connection stays open.
            headers = [each for each in message["headers"] if each[0].lower() != b"connection"]
            message = {**message, "headers": [*headers, (b"x-content-type-options", b"nosniff")]}
        self._complete = message["type"] == "http.response.body" and not message.get("more_body", False)
        await send(message)


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
