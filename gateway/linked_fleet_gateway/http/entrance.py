"""The layer in front of all resources: every request passes it, and its findings are in ``Arrival``.

In this order: bounds of header fields, address of the client, request id, operator endpoints, pages of other origins,
public URL, caller, rate limit, and modules to be loaded. CORS serves pages of other sites that may use the fleet
(WHATWG Fetch, "HTTP-CORS protocol"). Rates are limited by client; stops are neither refused nor counted. Modules that a
request needs first are loaded in a thread before the request proceeds.
"""

import asyncio
import math
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial
from importlib import import_module
from typing import Final

from starlette.datastructures import Headers
from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware
from starlette.requests import Request as StarletteRequest
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from linked_fleet_base.errors import FleetError, TooManyRequests
from linked_fleet_gateway.http.arrival import arrival_of
from linked_fleet_gateway.http.callers import identify, identify_static_token
from linked_fleet_gateway.http.field_bounds import enforce_bounds, is_within_bounds
from linked_fleet_gateway.http.forwarding import Authorities, Network, find_client, send_early, send_problem
from linked_fleet_gateway.http.operator_endpoints import PAGES
from linked_fleet_gateway.http.problem import rate_refusal
from linked_fleet_gateway.http.request import Request, gateway_of, html_of
from linked_fleet_gateway.http.scheduling import TokenBuckets, bucket_key, may_stop
from linked_fleet_gateway.resources.html import HtmlWriter
from linked_fleet_runtime.log import RequestContext, begin_request, choose_request_id
from linked_fleet_runtime.metrics import RequestMetrics
from linked_fleet_runtime.tracing import Tracing
from linked_fleet_server.exchange import Reply


class RateLimiter:
    """Refuses requests above the caller's rate, before anything is read or resolved.

    ``carriers``: paths whose requests contain others in their bodies, which ``await_turn`` counts after reading them.
    """

    def __init__(self, rates: TokenBuckets, carriers: Collection[str] = ()) -> None:
        self._rates, self._carriers = rates, frozenset(carriers)

    def wait_s(self, scope: Scope) -> float:
        """Return the seconds until the request is permitted; 0 if it is now, and then counted, once."""
        if not self._rates.is_limited or may_stop(scope) or scope["path"].rstrip("/") in self._carriers:
            return 0.0
        arrival = arrival_of(scope)
        if arrival.rate_counted:
            return 0.0
        wait_s = self._rates.take(bucket_key(scope))
        arrival.rate_counted = not wait_s
        return wait_s

    def refusal(self, scope: Scope) -> Reply | None:
        """Count the request, and return its refusal if it comes too early."""
        wait_s = self.wait_s(scope)
        return rate_refusal(math.ceil(wait_s)) if wait_s else None


async def await_turn(request: Request) -> None:
    """Count a request that could have been a stop, and wait for its turn. Raises TooManyRequests.

    It is called for a path that looks like that of a stop and is none, and after reading by the extension that serves a
    carrier, unless it is a stop.
    """
    wait_s = request.services.rates.take(bucket_key(request.scope))
    if wait_s:
        raise TooManyRequests(math.ceil(wait_s))
    await request.services.stop_priority.wait_for_turn()


SUBSCRIPTION_MODULES: Final = ("httpx",)


class ModuleLoader:
    """Loads modules in a thread: each takes 0.1 s, in which the event loop would serve nobody else."""

    def __init__(self, load: Callable[[str], object] = import_module) -> None:
        self._load = load
        self._loaded: set[tuple[str, ...]] = set()

    async def load(self, scope: Scope) -> None:
        """Return when the modules that a request needs have been imported."""
        if len(self._loaded) < 2 and scope["type"] == "http":
            needed, html = _needed(scope)
            if needed and needed not in self._loaded:
                await asyncio.to_thread(self._load_all, needed, html)
                self._loaded.add(needed)

    def _load_all(self, names: tuple[str, ...], html: HtmlWriter | None) -> None:
        for name in names:
            self._load(name)
        if html is not None:
            html.prepare()


def _needed(scope: Scope) -> tuple[tuple[str, ...], HtmlWriter | None]:
    """Return the modules, and the writer that is needed for a page."""
    path, method = scope["path"].rstrip("/"), scope["method"]
    if method in ("POST", "PATCH"):
        container = path if method == "POST" else path.rpartition("/")[0]
        return (SUBSCRIPTION_MODULES if container.endswith("/subscriptions") else ()), None
    html = html_of(scope)
    page = b"text/html" in arrival_of(scope).fields.get(b"accept", b"")
    return (tuple(html.modules), html) if html is not None and page else ((), None)


REQUEST_ID = "X-Request-Id"
_ID_FIELD = REQUEST_ID.lower().encode()
_STARTS = ("http.response.start", "websocket.http.response.start", "websocket.accept")
_TRACED = ("POST", "PUT", "PATCH", "DELETE")
_LONGEST_PATH = 1024


class Entrance:
    """The ASGI application of a gateway. ``cors``: middleware for pages of other origins (``cors_middleware``)."""

    def __init__(
        self,
        authorities: Authorities,
        requests: RequestMetrics,
        rates: TokenBuckets,
        *,
        fronts: Sequence[Network] = (),
        tracing: Tracing | None = None,
        cors: Sequence[Middleware] = (),
        carriers: Collection[str] = (),
    ) -> None:
        self._authorities, self._requests, self._tracing = authorities, requests, tracing
        self._fronts, self._pace, self._loading = tuple(fronts), RateLimiter(rates, carriers), ModuleLoader()
        self._inside: ASGIApp = self._admit
        for each, arguments, named in cors:
            self._inside = each(self._inside, *arguments, **named)

    def reply_nowait(self, scope: Scope) -> Reply | None:
        """Return the response to a GET that needs no waiting, also for its caller; None for any other request.

        ``__call__`` answers, or refuses, all for which this is None.
        """
        begun_s, arrival, gateway = time.monotonic(), arrival_of(scope), gateway_of(scope)
        identities = gateway.services.identities
        if b"origin" in arrival.fields or scope["path"] in PAGES or not is_within_bounds(scope):
            return None
        if self._refusal(scope) is not None:
            return None
        if identities is not None and not identify_static_token(identities, arrival):
            return None
        reply = self._pace.refusal(scope) or gateway.endpoint.reply_nowait(scope)
        if reply is None:
            return None
        reply.block += b"%b: %b\r\n" % (_ID_FIELD, choose_request_id(arrival.fields.get(_ID_FIELD)).encode())
        self._requests.add(scope["method"], reply.status, time.monotonic() - begun_s)
        return reply

    def _refusal(self, scope: Scope) -> FleetError | None:
        """Find the client's address and the public URL. Return the reason to refuse the request; None without one."""
        find_client(scope, self._fronts)
        try:
            self._authorities.check_authority(scope)
        except FleetError as error:
            return error
        return None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        refusal = None if is_within_bounds(scope) else enforce_bounds(scope)
        page = PAGES.get(scope["path"]) if scope["type"] == "http" else None
        context = begin_request(arrival_of(scope).fields.get(_ID_FIELD))
        if self._tracing is not None and page is None and scope.get("method") in _TRACED:
            path = scope["raw_path"].decode("latin-1")[:_LONGEST_PATH]
            parents = Headers(scope=scope).getlist("traceparent")
            context.trace = self._tracing.start_request_span(
                scope["method"], scope["scheme"], path, parents, context.id
            )
        answer = partial(self._answer, scope, context, page is None, send)
        try:
            if refusal is not None:
                await send_problem(refusal, scope, answer)
            elif page is None:
                await self._inside(scope, receive, answer)
            else:
                response = await page(StarletteRequest(scope, receive))
                await response(scope, receive, answer)
        finally:
            if context.trace is not None:
                context.trace.end()
                context.trace = None  # contexts that were inherited live longer

    async def _answer(self, scope: Scope, context: RequestContext, counted: bool, send: Send, message: Message) -> None:
        if message["type"] in _STARTS:
            context.response_started = True
            if counted:
                took_s = time.monotonic() - context.started_s
                self._requests.add(scope.get("method", "GET"), message.get("status", 101), took_s)
            if context.trace is not None:
                context.trace.set_status(message["status"])
            message["headers"] = [*message.get("headers", ()), (_ID_FIELD, context.id.encode())]
        await send(message)

    async def _admit(self, scope: Scope, receive: Receive, send: Send) -> None:
        gateway = gateway_of(scope)
        services = gateway.services
        if (error := self._refusal(scope)) is not None:
            await send_problem(error, scope, send)
            return
        if services.identities is not None:
            answer = await identify(services.identities, services.schemes, scope, receive, send)
            if answer is None:
                return
            send = answer
        refusal = self._pace.refusal(scope)
        if refusal is not None:
            await send_early(refusal.status, refusal.fields, refusal.content, scope, send)
            return
        await self._loading.load(scope)
        await gateway.endpoint(scope, receive, send)


_METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS")
_ASKED = (
    "authorization", "content-type", "if-match", "if-none-match", "idempotency-key", "last-event-id", "lock-token",
    "prefer", "traceparent", "x-request-id",
)  # fmt: skip
_ANSWERED = (
    "accept-patch", "accept-post", "accept-put", "allow", "etag", "link", "location", "lock-token",
    "preference-applied", "retry-after", "www-authenticate", "x-request-id",
)  # fmt: skip


def cors_middleware(
    origins: tuple[str, ...], request_fields: Iterable[str] = (), response_fields: Iterable[str] = ()
) -> list[Middleware]:
    """Return the middleware; none without ``origins``. Cookies are excluded, because these pages use tokens.

    ``request_fields`` and ``response_fields`` are further fields that pages may send and read.
    """
    if not origins:
        return []
    return [
        Middleware(
            CORSMiddleware,
            allow_origins=origins, allow_methods=_METHODS, allow_headers=(*_ASKED, *request_fields),
            expose_headers=(*_ANSWERED, *response_fields),
            allow_credentials=False,
        )
    ]  # fmt: skip
