"""The layer in front of all resources: every request passes it, and its findings are in ``Arrival``.

In this order: address of the client, request id, operator endpoints, pages of other origins, public URL, caller, rate
limit, and modules to be loaded.
"""

import time
from collections.abc import Collection, Sequence
from functools import partial

from starlette.datastructures import Headers
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from linked_fleet_gateway.base.errors import FleetError
from linked_fleet_gateway.http.answers import Reply
from linked_fleet_gateway.http.arrival import arrival_of
from linked_fleet_gateway.http.callers import identify, known_at_once
from linked_fleet_gateway.http.forwarded import Network, find_client
from linked_fleet_gateway.http.host import Authorities, refuse
from linked_fleet_gateway.http.lazy_imports import ModuleLoader
from linked_fleet_gateway.http.operator_endpoints import PAGES
from linked_fleet_gateway.http.pace import RateLimiter
from linked_fleet_gateway.http.rates import TokenBuckets
from linked_fleet_gateway.http.request import gateway_of
from linked_fleet_gateway.runtime.metrics import Requests
from linked_fleet_gateway.runtime.request_context import RequestContext, begin, request_id
from linked_fleet_gateway.runtime.tracing import Tracing

REQUEST_ID = "X-Request-Id"
_ID_FIELD = REQUEST_ID.lower().encode()
_STARTS = ("http.response.start", "websocket.http.response.start", "websocket.accept")
_TRACED = ("POST", "PUT", "PATCH", "DELETE")
_LONGEST_PATH = 1024


class Entrance:
    """The ASGI application of a gateway. ``elsewhere``: middleware for pages of other origins (``http/cors.py``)."""

    def __init__(
        self,
        authorities: Authorities,
        requests: Requests,
        rates: TokenBuckets,
        *,
        fronts: Sequence[Network] = (),
        tracing: Tracing | None = None,
        elsewhere: Sequence[Middleware] = (),
        carriers: Collection[str] = (),
    ) -> None:
        self._authorities, self._requests, self._tracing = authorities, requests, tracing
        self._fronts, self._pace, self._loading = tuple(fronts), RateLimiter(rates, carriers), ModuleLoader()
        self._inside: ASGIApp = self._admit
        for each, arguments, named in elsewhere:
            self._inside = each(self._inside, *arguments, **named)

    def at_once(self, scope: Scope) -> Reply | None:
        """Return the cached response to a GET of a caller who is known without waiting; None for any other request.

        The checks are those of ``__call__``; a request that does not pass them is refused there.
        """
        begun_s, arrival, services = time.monotonic(), arrival_of(scope), gateway_of(scope).services
        if b"origin" in arrival.fields:
            return None
        if self._fronts:
            find_client(scope, self._fronts)
        try:
            self._authorities.admit(scope)
        except FleetError:
            return None
        if services.identities is not None and not known_at_once(services.identities, arrival):
            return None
        reply = services.answers.find(scope, services.live)
        if reply is None or self._pace.wait_s(scope):
            return None
        reply.more.append((_ID_FIELD, request_id(arrival.fields.get(_ID_FIELD)).encode()))
        self._requests.add(scope["method"], reply.status, time.monotonic() - begun_s)
        return reply

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        find_client(scope, self._fronts)
        page = PAGES.get(scope["path"]) if scope["type"] == "http" else None
        context = begin(arrival_of(scope).fields.get(_ID_FIELD))
        if self._tracing is not None and page is None and scope.get("method") in _TRACED:
            path = scope["raw_path"].decode("latin-1")[:_LONGEST_PATH]
            parents = Headers(scope=scope).getlist("traceparent")
            context.trace = self._tracing.begin(scope["method"], scope["scheme"], path, parents, context.id)
        answer = partial(self._answer, scope, context, page is None, send)
        try:
            if page is None:
                await self._inside(scope, receive, answer)
            else:
                response = await page(Request(scope, receive))
                await response(scope, receive, answer)
        finally:
            if context.trace is not None:
                context.trace.end()
                context.trace = None  # contexts that were inherited live longer

    async def _answer(self, scope: Scope, context: RequestContext, counted: bool, send: Send, message: Message) -> None:
        if message["type"] in _STARTS:
            context.answered = True
            if counted:
                took_s = time.monotonic() - context.begun_s
                self._requests.add(scope.get("method", "GET"), message.get("status", 101), took_s)
            if context.trace is not None:
                context.trace.answered(message["status"])
            message["headers"] = [*message.get("headers", ()), (_ID_FIELD, context.id.encode())]
        await send(message)

    async def _admit(self, scope: Scope, receive: Receive, send: Send) -> None:
        gateway = gateway_of(scope)
        services = gateway.services
        try:
            self._authorities.admit(scope)
        except FleetError as error:
            await refuse(error, scope, send)
            return
        if services.identities is not None:
            answer = await identify(services.identities, services.schemes, scope, receive, send)
            if answer is None:
                return
            send = answer
        try:
            self._pace.check(scope)
        except FleetError as error:
            await refuse(error, scope, send)
            return
        await self._loading.load(scope)
        await gateway.endpoint(scope, receive, send)
