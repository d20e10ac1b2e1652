"""Endpoints for operators, answered before the tree: liveness, readiness with warnings, and metrics.

They are outside the tree under reserved names, so that no robot can have such a name, and independent of ``Host``,
because probes use the gateway's own address, which is no public URL of the fleet.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping
from functools import partial

from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from linked_fleet_base.errors import FleetError, InsufficientScope
from linked_fleet_gateway.http.callers import identify_bearer
from linked_fleet_gateway.http.problem import problem
from linked_fleet_gateway.http.request import Gateway, gateway_of, html_of
from linked_fleet_identity.rights import Right


async def live(request: Request) -> Response:
    """Return 200 while the process serves: reads, streams and stops need neither Redis nor robots."""
    return JSONResponse({"status": "live"})


async def ready(request: Request) -> Response:
    """Return 200, or 503 with what is missing: Zenoh, Redis, the checks of motions, or because it is shutting down.

    Three states are only warnings, because the gateway serves everything including ``stop``: damaged or lost data of
    Redis, shapes being prepared for a robot that joins a gateway that was ready before, and faults of
    extensions and descriptions.
    """
    gateway = gateway_of(request.scope)
    missing = list(_missing(gateway))
    faults = gateway.services.live.faults
    warnings = [warning for warning in (gateway.services.data_warning(),) if warning] + faults.of_parts
    if faults.robots:  # whoever reads this may not be allowed to know their names
        warnings.append(f"Some descriptions of {len(faults.robots)} robots are incomplete; the log has the reasons.")
    if not missing:
        (warnings if gateway.has_been_ready else missing).extend(gateway.services.not_ready_reasons())
    more = {"warnings": warnings} if warnings else {}
    if missing:
        return JSONResponse({"status": "not ready", "reasons": missing, **more}, 503)
    gateway.has_been_ready = True
    return JSONResponse({"status": "ready", **more})


def _missing(gateway: Gateway) -> Iterator[str]:
    if gateway.draining:
        yield "the gateway is ending"
    if not gateway.services.live.link.is_connected:
        yield "no robot, router or other gateway is connected by Zenoh"
    if not gateway.services.subscriptions.store_is_available:
        yield "Redis does not answer"


_READ = ("GET", "HEAD", "OPTIONS")
Page = Callable[[Request], Awaitable[Response]]


async def _metrics(request: Request) -> Response:
    """Return all metrics as text. Rendered in a thread: for ten thousand robots it is a megabyte."""
    text = await asyncio.to_thread(generate_latest, gateway_of(request.scope).services.registry)
    return Response(text, headers={"content-type": CONTENT_TYPE_PLAIN_0_0_4})


def _for_administrators(metrics: Page) -> Page:
    """Restrict a page to administrators of all robots if there are identities, because metrics name all robots.

    Only bearer tokens are accepted: sessions are bound to a known host, which is not yet checked here.
    """

    async def admitted(request: Request) -> Response:
        identities = gateway_of(request.scope).services.identities
        if identities is not None:
            try:
                caller = await identify_bearer(identities, request.headers)
                if not caller.has_right(Right.ADMIN, None):
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


PAGES: Mapping[str, Page] = {
    "/health/live": partial(_answer, live),
    "/health/ready": partial(_answer, ready),
    "/metrics": _for_administrators(partial(_answer, _metrics)),
}
"""The endpoints by path."""
