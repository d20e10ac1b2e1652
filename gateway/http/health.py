"""Liveness and readiness of a gateway, and what its operator should know besides."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from gateway.runtime.damaged_data import statement
from gateway.runtime.embedded_redis import Embedded


@dataclass
class Readiness:
    """The memory of a gateway from which it tells that it is ready."""

    draining: bool = False
    """It ends when the work under way is done."""
    has_been_ready: bool = False


PREPARING = "the shapes of robots are being prepared for the check of their motions"


async def live(request: Request) -> Response:
    """200 as long as the process serves: reads, streams and stops need no Redis, and the robots may be away."""
    return JSONResponse({"status": "live"})


async def ready(request: Request) -> Response:
    """200, or 503 with what is missing: the robots' side, Redis, the check of motions, or the will to go on.

    Two states are warnings, because the gateway serves everything, ``stop`` above all: damaged data of the embedded
    server, and shapes that are prepared for a robot which joins a gateway that has been ready before.
    """
    state = request.app.state
    readiness: Readiness = state.readiness
    missing, warnings = list(_missing(state)), [warning for warning in (store_warning(state),) if warning]
    if not missing and not state.world.checks.prepared:
        (warnings if readiness.has_been_ready else missing).append(PREPARING)
    more = {"warnings": warnings} if warnings else {}
    if missing:
        return JSONResponse({"status": "not ready", "reasons": missing, **more}, 503)
    readiness.has_been_ready = True
    return JSONResponse({"status": "ready", **more})


def store_warning(state: Any) -> str:
    """One sentence about data that the embedded server could not load; empty if there are none."""
    embedded: Embedded | None = state.embedded
    return "" if embedded is None else statement(embedded.set_aside)


def _missing(state: Any) -> Iterator[str]:
    """``state`` is that of the application."""
    if state.readiness.draining:
        yield "the gateway is ending"
    if not state.live.link.joined:
        yield "no robot, router or other gateway is connected by Zenoh"
    if not state.subscriptions.store_answers:
        yield "Redis does not answer"
