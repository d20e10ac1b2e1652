"""Which answers the protocol may give again by itself (``gateway.http.repeats``), and for how long."""

import time
from collections.abc import Callable, Sequence

from starlette.requests import Request

from gateway.http.fields import field
from gateway.http.protocol import HTTP, HttpProtocol
from gateway.http.repeats import Repeat, is_plain
from gateway.http.rights import caller_of
from gateway.identity.rights import TokenHash
from gateway.identity.service import Identities
from gateway.resources.resource import Resource
from gateway.resources.template import Rendering, compiles


def offer_repeat(request: Request, resource: Resource, media_type: str, base: str) -> None:
    """Have the answer to a read kept, once it is known, if it can be given again."""
    http: HttpProtocol | None = request.scope.get("extensions", {}).get(HTTP)
    holds = _holding(request, resource)
    if http is None or holds is None or not (compiles(resource, media_type) and is_plain(request.scope)):
        return
    caller = caller_of(request)
    client = f"identity {caller.name}" if caller.name else None
    rendering = Rendering(resource, media_type, base)
    repeat = Repeat(resource, rendering, client, field(request, "if-none-match"), holds)

    def answered(status: int, headers: Sequence[tuple[bytes, bytes]]) -> None:
        if repeat.answered(status, headers):
            http.remember(repeat)

    request.state.answered = answered


def _holding(request: Request, resource: Resource) -> Callable[[], bool] | None:
    """Whether the resource is the same one and who asks may still read it; None where that takes a longer look."""
    robot = resource.source.robot
    if robot is None:
        return None
    description = robot.description
    identities: Identities | None = request.app.state.identities
    if identities is None:
        return lambda: robot.description is description
    caller, roster = caller_of(request), identities.roster
    if not isinstance(caller.credential, TokenHash):  # sessions can be ended, and the keys of issuers taken back
        return None
    expires_ns = caller.expires_ns

    def holds() -> bool:
        lasts = expires_ns is None or time.time_ns() < expires_ns
        return robot.description is description and identities.roster is roster and lasts

    return holds
