"""Bounds of the header fields and the query of a request, which are checked before anybody parses them.

A field of the permitted size of a head can have thousands of members, and a list is compared with whatever the resource
offers. Each field that is parsed as a list therefore has a limit of members. A request beyond it is refused, even if
RFC 9110 (12.1) permits ignoring the field, because its client would think that it was heard. A stop is not refused: it
is read without that field.
"""

from collections.abc import Mapping
from typing import Final

from starlette.types import Scope

from linked_fleet_base.errors import BadRequest, FieldsTooLarge, FleetError
from linked_fleet_gateway.http.arrival import arrival_of
from linked_fleet_gateway.http.scheduling import may_stop

MAX_MEMBERS: Final = 64
"""Limit of members of one field, with the parameters of its members."""
MAX_LINES: Final = 128
"""Limit of lines of the header block."""
MAX_PARAMETERS: Final = 256
"""Limit of parameters of a query."""
_LISTS: Final = frozenset(
    name.encode()
    for name in (
        "accept", "accept-charset", "accept-encoding", "accept-language", "access-control-request-headers",
        "cache-control", "callback", "connection", "content-encoding", "content-type", "cookie", "expect", "forwarded",
        "if", "if-match", "if-none-match", "link", "lock-token", "idempotency-key", "origin", "prefer", "range",
        "sec-websocket-extensions", "sec-websocket-protocol", "te", "traceparent", "tracestate", "trailer", "upgrade",
        "via", "x-forwarded-for", "x-forwarded-host", "x-forwarded-proto",
    )
)  # fmt: skip


def is_within_bounds(scope: Scope) -> bool:
    """Return True for a request within all bounds."""
    fields, query = arrival_of(scope).fields, scope["query_string"]
    if len(scope["headers"]) > MAX_LINES or (query and query.count(b"&") >= MAX_PARAMETERS):
        return False
    for name, value in fields.items():
        if len(value) > MAX_MEMBERS and name in _LISTS and _members(value) > MAX_MEMBERS:
            return False
    return True


def enforce_bounds(scope: Scope) -> FleetError | None:
    """Remove from a request what exceeds a bound, and return the reason to refuse it; None for a stop."""
    refusal = _refusal(scope)
    arrival = arrival_of(scope)
    removed = _too_long(arrival.fields)
    scope["headers"] = [line for line in scope["headers"] if line[0] not in removed]
    arrival.fields = {name: value for name, value in arrival.fields.items() if name not in removed}
    if scope["query_string"].count(b"&") >= MAX_PARAMETERS:
        scope["query_string"] = b""
    return None if may_stop(scope) else refusal


def _refusal(scope: Scope) -> FleetError:
    named = sorted(_too_long(arrival_of(scope).fields))
    if named:
        return FieldsTooLarge(
            f"The field {named[0].decode('ascii')} has more than {MAX_MEMBERS} members and parameters. "
            f"Send at most {MAX_MEMBERS}."
        )
    if len(scope["headers"]) > MAX_LINES:
        return FieldsTooLarge(f"The request has more than {MAX_LINES} header fields. Send at most {MAX_LINES}.")
    return BadRequest(f"The query has more than {MAX_PARAMETERS} parameters. Send at most {MAX_PARAMETERS}.")


def _too_long(fields: Mapping[bytes, bytes]) -> set[bytes]:
    return {name for name, value in fields.items() if name in _LISTS and _members(value) > MAX_MEMBERS}


def _members(value: bytes) -> int:
    """Return an upper bound of the number of members and parameters, without parsing quoted strings."""
    return max(value.count(b",") + value.count(b";") + 1, value.count(b'"') // 2)
