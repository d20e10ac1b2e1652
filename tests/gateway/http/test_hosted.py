"""Responses of applications from other packages."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from linked_fleet_gateway.http.hosted import AsgiResponse
from linked_fleet_server.protocol import HTTP


class Exchange:
    """A request whose client stays until ``leave`` is set; ``said``: the response."""

    def __init__(self) -> None:
        self.http = SimpleNamespace(on_shutdown=None, is_shutting_down=False)
        self.leave = asyncio.Event()
        self.said: list[Message] = []
        self.begun = asyncio.Event()

    async def answer(self, hosted: AsgiResponse) -> None:
        scope = {"type": "http", "method": "POST", "path": "/", "headers": [], "extensions": {HTTP: self.http}}
        await hosted(scope, self._receive, self._send)

    async def _receive(self) -> Message:
        await self.leave.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Message) -> None:
        self.said.append(message)
        self.begun.set()


async def _stream(scope: Scope, receive: Receive, send: Send) -> None:
    """Send an endless response until the client leaves."""
    assert (await receive())["body"] == b"asked"
    await send({"type": "http.response.start", "status": 200, "headers": [(b"Connection", b"keep-alive")]})
    await send({"type": "http.response.body", "body": b"first", "more_body": True})
    assert (await receive())["type"] == "http.disconnect"


def test_the_application_reads_the_body_and_what_was_added_to_the_scope() -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        content = await Request(scope, receive).body()
        await Response(content + scope["extensions"]["mine"])(scope, receive, send)

    async def run() -> list[Message]:
        exchange = Exchange()
        await exchange.answer(AsgiResponse(app, b"asked", {"mine": b" here"}))
        return exchange.said

    start, body = asyncio.run(run())
    assert (start["status"], body["body"]) == (200, b"asked here")
    assert (b"x-content-type-options", b"nosniff") in start["headers"]


@pytest.mark.parametrize("who", ["client", "gateway"])
def test_a_stream_ends_with_its_client_and_with_the_gateway(who: str) -> None:
    ended: list[bool] = []

    async def run() -> list[Message]:
        exchange = Exchange()
        task = asyncio.create_task(exchange.answer(AsgiResponse(_stream, b"asked", {}, lambda: ended.append(True))))
        await exchange.begun.wait()
        if who == "client":
            exchange.leave.set()
        else:
            exchange.http.on_shutdown()  # type: ignore[misc]
        await task
        assert exchange.http.on_shutdown is None
        return exchange.said

    start, first, last = asyncio.run(run())
    assert start["headers"] == [(b"x-content-type-options", b"nosniff")]
    assert (first["body"], last["body"], last["more_body"]) == (b"first", b"", False)
    assert ended == ([] if who == "client" else [True])


def test_an_application_started_during_shutdown_ends_at_once() -> None:
    async def silent(scope: Scope, receive: Receive, send: Send) -> None:
        await receive()
        assert (await receive())["type"] == "http.disconnect"

    async def run() -> list[Message]:
        exchange = Exchange()
        exchange.http.is_shutting_down = True
        await exchange.answer(AsgiResponse(silent, b"", {}))
        return exchange.said

    assert asyncio.run(run())[0]["status"] == 503


def test_a_whole_answer_is_ended_once() -> None:
    async def parts() -> Any:
        yield b"a"
        yield b"b"

    async def run() -> list[Message]:
        exchange = Exchange()
        app: ASGIApp = StreamingResponse(parts())
        await exchange.answer(AsgiResponse(app, b"", {}))
        return exchange.said

    assert [each.get("body") for each in asyncio.run(run())] == [None, b"a", b"b", b""]
