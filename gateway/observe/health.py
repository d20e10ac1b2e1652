"""Whether a gateway lives, and whether it can do all of its work."""

from collections.abc import Iterator
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response


async def live(request: Request) -> Response:
    """200 as long as the process serves: reads, streams and stops need no Redis, and the robots may be away."""
    return JSONResponse({"status": "live"})


async def ready(request: Request) -> Response:
    """200, or 503 with what is missing: the robots' side, Redis, or the will to go on."""
    missing = list(_missing(request.app.state))
    if missing:
        return JSONResponse({"status": "not ready", "reasons": missing}, 503)
    return JSONResponse({"status": "ready"})


def _missing(state: Any) -> Iterator[str]:
    """``state`` is that of the application."""
    if getattr(state, "draining", False):
        yield "the gateway is ending"
    if not state.live.link.joined:
        yield "no robot, router or other gateway is connected by Zenoh"
    if not state.subscriptions.store_answers:
        yield "Redis does not answer"
