"""The proof of a control lease in a request, also in that of a WebSocket."""

import re

from linked_fleet_base.errors import BadRequest
from linked_fleet_gateway.actions.plan import Caller
from linked_fleet_gateway.http.demands import refuse_demands
from linked_fleet_gateway.http.request import Connection, WebSocket
from linked_fleet_gateway.resources.affordance import Demand

_TOKEN = re.compile(r"<(urn:uuid:[0-9a-f-]{36})>|(urn:uuid:[0-9a-f-]{36})")
LEASE_SUBPROTOCOL = "lf.lease."


def lock_token(request: Connection) -> str:
    """Return the ``Lock-Token`` of a control lease (RFC 4918, 10.5); empty without one."""
    said = request.arrival.fields.get(b"lock-token")
    if said is None:
        return ""
    match = _TOKEN.fullmatch(said.decode("latin-1").strip())
    if match is None:
        raise BadRequest("Lock-Token is what the control lease came with, such as <urn:uuid:...>.")
    return match[1] or match[2]


def websocket_caller(websocket: WebSocket) -> Caller:
    """Return the caller of an action that a WebSocket runs, with the proof of its lease.

    That is the field ``Lock-Token`` or, because browsers cannot set fields on a WebSocket, the subprotocol
    ``lf.lease.`` with the UUID of the token. Raises BadRequest for one that is malformed, and for demands that a
    WebSocket does not honour.
    """
    refuse_demands(websocket.arrival.fields, frozenset({Demand.LOCK_TOKEN}))
    named = [each.removeprefix(LEASE_SUBPROTOCOL) for each in websocket.scope["subprotocols"] if _is_lease(each)]
    token = lock_token(websocket)
    if named and (token or len(named) > 1 or not _TOKEN.fullmatch(f"urn:uuid:{named[0]}")):
        raise BadRequest(f"{LEASE_SUBPROTOCOL}UUID names the token of one control lease, and replaces Lock-Token.")
    return Caller(
        websocket.caller_name,
        f"urn:uuid:{named[0]}" if named else token,
        visible_robots=websocket.caller.visible_robots,
        identity=websocket.caller,
    )


def _is_lease(subprotocol: str) -> bool:
    return subprotocol.startswith(LEASE_SUBPROTOCOL)
