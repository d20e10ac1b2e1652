"""Demands of writes that are honoured or refused: preferences, preconditions, Idempotency-Key and Lock-Token.

A handler declares in its affordance which of them it honours (``resources.affordance.Demand``). All others are refused
before it is called, because a write that ignores them does what its client has excluded. Stops ignore all fields.
"""

from collections.abc import Mapping

from linked_fleet_base.errors import BadRequest, PreconditionFailed
from linked_fleet_gateway.http.fields import NO_PREFERENCE, Prefer, parse_prefer
from linked_fleet_gateway.resources.affordance import EVERYTHING, Demand, EndInvocation, Honours, Invoke, honoured_by
from linked_fleet_gateway.resources.resource import Resource

_UNCHANGED = "Nothing has changed."
_NOT_REHEARSED = f"This cannot be rehearsed; it is done without Prefer: dry-run. {_UNCHANGED}"
_REFUSALS = {
    b"idempotency-key": (
        Demand.IDEMPOTENCY_KEY,
        BadRequest,
        "Requests to this resource are not recognised by an Idempotency-Key; send it without one, and read the resource"
        " before you repeat the request.",
    ),
    b"lock-token": (
        Demand.LOCK_TOKEN,
        BadRequest,
        "A control lease does not protect this resource; send the request without Lock-Token.",
    ),
    b"if-match": (
        Demand.PRECONDITIONS,
        PreconditionFailed,
        "If-Match is not evaluated at this resource; send the request without it.",
    ),
    b"if-none-match": (
        Demand.PRECONDITIONS,
        PreconditionFailed,
        "If-None-Match is not evaluated at this resource; send the request without it.",
    ),
    b"if-unmodified-since": (
        Demand.OTHER_PRECONDITIONS,
        PreconditionFailed,
        "Resources have no Last-Modified; send If-Match with an ETag instead of If-Unmodified-Since.",
    ),
    b"if": (
        Demand.OTHER_PRECONDITIONS,
        PreconditionFailed,
        "The field If (RFC 4918) is not evaluated; send If-Match with an ETag, or Lock-Token.",
    ),
}
_FIELDS = frozenset({b"prefer", *_REFUSALS})


def check_demands(fields: Mapping[bytes, bytes], resource: Resource) -> None:
    """Refuse a write of the resource with a demand that its handler does not honour.

    Raises BadRequest, PreconditionFailed.
    """
    honours = honoured_by(resource.affords)
    refuse_demands(fields, honours | {Demand.PRECONDITIONS} if resource.remote is None else honours)


def refuse_demands(fields: Mapping[bytes, bytes], honours: Honours) -> None:
    """Refuse a request with a demand outside ``honours``. Raises BadRequest, PreconditionFailed."""
    if honours >= EVERYTHING or _FIELDS.isdisjoint(fields):
        return
    said = fields.get(b"prefer")
    prefer = NO_PREFERENCE if said is None else parse_prefer(said.decode("latin-1"))
    if prefer.dry_run and Demand.DRY_RUN not in honours:
        raise BadRequest(_NOT_REHEARSED)
    for name, (demand, error, sentence) in _REFUSALS.items():
        if name in fields and demand not in honours:
            raise error(f"{sentence} {_UNCHANGED}")
    if prefer.strict and Demand.OTHER_PRECONDITIONS not in honours:
        _refuse_ignored(prefer, honours)


def _refuse_ignored(prefer: Prefer, honours: Honours) -> None:
    """Raise BadRequest for preferences that would be ignored, which ``handling=strict`` excludes (RFC 7240, 4.4)."""
    ignored = list(prefer.ignored)
    if Demand.RESPONSE not in honours:
        said = {"return": prefer.return_, "respond-async": prefer.respond_async, "wait": prefer.wait_s}
        ignored += [name for name, value in said.items() if value not in (None, False)]
    if ignored:
        named = ", ".join(ignored)[:200]
        raise BadRequest(f"Prefer has handling=strict, and this preference is not honoured here: {named}. {_UNCHANGED}")


def stops(resource: Resource) -> bool:
    """Return True for a resource whose write stops something. No header field prevents it."""
    affords = resource.affords
    return isinstance(affords, EndInvocation) or (isinstance(affords, Invoke) and affords.offer.is_stop)
