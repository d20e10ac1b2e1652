"""Liveness and readiness of a gateway, and what its operator should know besides."""

from collections.abc import Iterator

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from linked_fleet_gateway.http.request import Gateway, gateway_of
from linked_fleet_gateway.runtime.damaged_data import statement
from linked_fleet_gateway.runtime.embedded_redis import Embedded


async def live(request: Request) -> Response:
    """200 as long as the process serves: reads, streams and stops need no Redis, and the robots may be away."""
    return JSONResponse({"status": "live"})


async def ready(request: Request) -> Response:
    """200, or 503 with what is missing: the robots' side, Redis, the check of motions, or the will to go on.

    Two states are warnings, because the gateway serves everything, ``stop`` above all: damaged data of the embedded
    server, and shapes that are prepared for a robot which joins a gateway that has been ready before.
    """
    gateway = gateway_of(request.scope)
    missing = list(_missing(gateway))
    warnings = [warning for warning in (store_warning(gateway.services.embedded),) if warning]
    if not missing:
        (warnings if gateway.has_been_ready else missing).extend(gateway.services.unprepared())
    more = {"warnings": warnings} if warnings else {}
    if missing:
        return JSONResponse({"status": "not ready", "reasons": missing, **more}, 503)
    gateway.has_been_ready = True
    return JSONResponse({"status": "ready", **more})


def store_warning(embedded: Embedded | None) -> str:
    """One sentence about data that the embedded server could not load; empty if there are none."""
    return "" if embedded is None else statement(embedded.set_aside)


def _missing(gateway: Gateway) -> Iterator[str]:
    if gateway.draining:
        yield "the gateway is ending"
    if not gateway.services.live.link.joined:
        yield "no robot, router or other gateway is connected by Zenoh"
    if not gateway.services.subscriptions.store_answers:
        yield "Redis does not answer"
