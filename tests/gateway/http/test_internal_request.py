"""Requests that an extension makes for its client."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, cast

import pytest
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from linked_fleet_base.errors import BadRequest
from linked_fleet_gateway.http.arrival import arrival_of
from linked_fleet_gateway.http.forwarding import Authorities
from linked_fleet_gateway.http.internal_request import Reply, ReplyTooLong, ask
from linked_fleet_gateway.http.request import Application, Gateway, Request, WebSocket
from linked_fleet_runtime.log import begin_request, current_request

BASE = "https://fleet.example:8443"


class Outside:
    """A client with credentials, beside a gateway that responds by ``handler``."""

    def __init__(self, handler: Callable[[Request], Awaitable[Response]], kind: str = "http") -> None:
        self.gateway = Gateway(cast(Application, self._enter))

        async def endpoint(scope: Scope, receive: Receive, send: Send) -> None:
            await (await handler(Request(scope, receive)))(scope, receive, send)

        self.gateway.endpoint = cast(Application, endpoint)
        scope: Scope = {
            "type": kind, "scheme": "https" if kind == "http" else "wss", "app": self.gateway, "method": "POST",
            "path": "/outer", "raw_path": b"/outer", "query_string": b"", "client": ("192.0.2.7", 4711),
            "headers": [
                (b"host", b"fleet.example:8443"), (b"authorization", b"Bearer secret"), (b"cookie", b"session=1"),
                (b"content-type", b"text/plain"), (b"accept", b"text/event-stream"),
                (b"x-forwarded-for", b"198.51.100.1"),
            ],
        }  # fmt: skip
        arrival_of(scope).base = BASE
        self.connection: Any = Request(scope) if kind == "http" else WebSocket(scope, _never, _nothing)

    async def _enter(self, scope: Scope, receive: Receive, send: Send) -> None:
        Authorities((BASE,)).check_authority(scope)
        await self.gateway.endpoint(scope, receive, send)

    def ask(self, method: str, target: str, **more: Any) -> Reply:
        return asyncio.run(ask(self.connection, method, target, **more))


async def _never() -> Any:
    raise AssertionError("nobody reads from the connection of the client")


async def _nothing(_: Any) -> None:
    raise AssertionError("nobody writes to the connection of the client")


async def _echo(request: Request) -> Response:
    seen = {
        "method": request.method, "path": request.scope["raw_path"], "query": request.url.query,
        "headers": dict(request.headers),
        "client": request.client and request.client.host, "body": (await request.body()).decode(),
    }  # fmt: skip
    return Response(repr(seen), 201, {"location": request.base + "/made"})


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_the_request_has_the_credentials_of_the_client_and_no_other_field_of_its_own(kind: str) -> None:
    reply = Outside(_echo, kind).ask(
        "PUT", "/a%20b?as=c", fields={"Content-Type": "application/json", "accept": "*/*"}, content=b"{}"
    )
    seen = eval(reply.content)
    assert (reply.status, reply.headers["location"]) == (201, BASE + "/made")
    assert seen["headers"] == {
        "host": "fleet.example:8443",
        "authorization": "Bearer secret",
        "cookie": "session=1",
        "content-type": "application/json",
        "accept": "*/*",
        "content-length": "2",
    }
    assert {name: seen[name] for name in ("method", "path", "query", "client", "body")} == {
        "method": "PUT",
        "path": b"/a%20b",
        "query": "as=c",
        "client": "192.0.2.7",
        "body": "{}",
    }


def test_a_url_of_the_gateway_is_a_target_too() -> None:
    assert eval(Outside(_echo).ask("GET", BASE + "/robot/joint").content)["path"] == b"/robot/joint"


@pytest.mark.parametrize(
    "target", ["", "robot", "https://other.example/", BASE, BASE + ".evil/", "//other.example/", "/a b", "/a#b", "/ä"]
)
def test_any_other_target_is_refused(target: str) -> None:
    with pytest.raises(BadRequest):
        Outside(_echo).ask("GET", target)


def test_an_internal_request_makes_no_other_one() -> None:
    async def nested(request: Request) -> Response:
        with pytest.raises(BadRequest):
            await ask(request, "GET", "/")
        return Response("refused")

    assert Outside(nested).ask("GET", "/").content == b"refused"


def test_a_longer_answer_than_the_bound_is_refused() -> None:
    async def long(_: Request) -> Response:
        return Response(b"x" * 11)

    assert Outside(long).ask("GET", "/", longest=11).content == b"x" * 11
    with pytest.raises(ReplyTooLong):
        Outside(long).ask("GET", "/", longest=10)


async def test_the_outer_request_stays_the_present_one_and_gives_its_id() -> None:
    async def inner(request: Request) -> Response:
        begin_request(b"inner")
        return Response(request.headers["x-request-id"])

    begun = begin_request(b"outer")
    reply = await ask(Outside(inner).connection, "GET", "/")
    assert reply.content == b"outer"
    assert current_request() is begun


async def test_cancellation_is_passed_on_to_the_request() -> None:
    begun, ended = asyncio.Event(), asyncio.Event()

    async def slow(_: Request) -> Response:
        begun.set()
        try:
            await asyncio.Event().wait()
        finally:
            ended.set()
        raise AssertionError

    task = asyncio.create_task(ask(Outside(slow).connection, "GET", "/"))
    await begun.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert ended.is_set()
