"""Liveness and readiness of a gateway, with warnings for its operator."""

from collections.abc import Iterator

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from linked_fleet_gateway.http.request import Gateway, gateway_of
from linked_fleet_gateway.runtime.damaged_data import statement
from linked_fleet_gateway.runtime.embedded_redis import Embedded


async def live(request: Request) -> Response:
    """Return 200 while the process serves: reads, streams and stops need neither Redis nor robots."""
    return JSONResponse({"status": "live"})


async def ready(request: Request) -> Response:
    """Return 200, or 503 with what is missing: Zenoh, Redis, the checks of motions, or because it is shutting down.

    Two states are only warnings, because the gateway serves everything including ``stop``: damaged data of the embedded
    server, and shapes being prepared for a robot that joins a gateway that was ready before.
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
    """Return a sentence about data that the embedded server could not load; empty if there is none."""
    return "" if embedded is None else statement(embedded.set_aside)


def _missing(gateway: Gateway) -> Iterator[str]:
    if gateway.draining:
        yield "the gateway is ending"
    if not gateway.services.live.link.joined:
        yield "no robot, router or other gateway is connected by Zenoh"
    if not gateway.services.subscriptions.store_answers:
        yield "Redis does not answer"
