"""Endpoints for operators, answered before the tree: liveness, readiness, metrics.

Outside of the tree and under reserved names, so that no robot can be called like them, and whatever the ``Host``: who
probes a gateway asks it by its own address, which is no public URL of the fleet.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable
from functools import partial

from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from linked_fleet_gateway.base.errors import FleetError, InsufficientScope
from linked_fleet_gateway.http.callers import by_token
from linked_fleet_gateway.http.fields import fields_of
from linked_fleet_gateway.http.health import live, ready
from linked_fleet_gateway.http.problem import problem
from linked_fleet_gateway.http.request import gateway_of, html_of
from linked_fleet_gateway.identity.rights import Right
from linked_fleet_gateway.runtime.counters import Requests
from linked_fleet_gateway.runtime.request_context import begin
from linked_fleet_gateway.runtime.tracing import Tracing

REQUEST_ID = "X-Request-Id"
_ID_FIELD = REQUEST_ID.lower().encode()
_STARTS = ("http.response.start", "websocket.http.response.start", "websocket.accept")
_READ = ("GET", "HEAD", "OPTIONS")
_TRACED = ("POST", "PUT", "PATCH", "DELETE")
_LONGEST_PATH = 1024
Page = Callable[[Request], Awaitable[Response]]


class Front:
    """ASGI middleware, the outermost: gives each request its id, counts and traces it; operators are just answered."""

    def __init__(self, app: ASGIApp, requests: Requests, tracing: Tracing | None = None) -> None:
        self.app, self._requests, self._tracing = app, requests, tracing
        self._pages: dict[str, Page] = {
            "/health/live": partial(_answer, live),
            "/health/ready": partial(_answer, ready),
            "/metrics": _for_administrators(partial(_answer, _metrics)),
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        page = self._pages.get(scope["path"]) if scope["type"] == "http" else None
        asked = begin(fields_of(scope).get(_ID_FIELD, b"").decode("latin-1"))
        if self._tracing is not None and page is None and scope.get("method") in _TRACED:
            path = scope["raw_path"].decode("latin-1")[:_LONGEST_PATH]
            parents = Headers(scope=scope).getlist("traceparent")
            asked.trace = self._tracing.begin(scope["method"], scope["scheme"], path, parents, asked.id)

        async def answer(message: Message) -> None:
            if message["type"] in _STARTS:
                asked.answered = True
                if page is None:
                    took_s = time.monotonic() - asked.begun_s
                    self._requests.add(scope.get("method", "GET"), message.get("status", 101), took_s)
                if asked.trace is not None:
                    asked.trace.answered(message["status"])
                message["headers"] = [*message.get("headers", ()), (_ID_FIELD, asked.id.encode())]
            await send(message)

        try:
            if page is None:
                await self.app(scope, receive, answer)
            else:
                response = await page(Request(scope, receive))
                await response(scope, receive, answer)
        finally:
            if asked.trace is not None:
                asked.trace.end()
                asked.trace = None  # contexts that were inherited live longer


async def _metrics(request: Request) -> Response:
    """All numbers as text. It is put together in a thread: of ten thousand robots it is a megabyte."""
    text = await asyncio.to_thread(generate_latest, gateway_of(request.scope).services.registry)
    return Response(text, headers={"content-type": CONTENT_TYPE_PLAIN_0_0_4})


def _for_administrators(metrics: Page) -> Page:
    """The numbers name all robots: where there are identities, they are for who may administer all of them.

    By a token: sessions are for pages of a host that is known, and nobody has looked yet which host was asked.
    """

    async def admitted(request: Request) -> Response:
        identities = gateway_of(request.scope).services.identities
        if identities is not None:
            try:
                caller = await by_token(identities, request.headers)
                if not caller.may(Right.ADMIN, None):
                    raise InsufficientScope("The numbers are for who may administer all robots.", scope=Right.ADMIN)
            except FleetError as error:
                body, headers = problem(error, request.headers.get("accept"), html=html_of(request.scope))
                return Response(body, error.status, headers)
        return await metrics(request)

    return admitted


async def _answer(page: Page, request: Request) -> Response:
    allow = {"allow": ", ".join(_READ)}
    if request.method not in _READ:
        text = f"{request.method} is not possible here; {allow['allow']} are."
        return JSONResponse({"status": 405, "detail": text}, 405, allow, "application/problem+json")
    if request.method == "OPTIONS":
        return Response(status_code=204, headers=allow)
    response = await page(request)
    response.headers["cache-control"] = "no-store"
    response.headers["x-content-type-options"] = "nosniff"
    return response
