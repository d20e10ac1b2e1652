"""If-Match and, for writes, If-None-Match (RFC 9110, 13.1.1 and 13.1.2)."""

from collections.abc import Callable, Iterator

from linked_fleet_gateway.base.errors import PreconditionFailed
from linked_fleet_gateway.http.conditional import not_modified, precondition_holds
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.affordance import EndInvocation, Invoke
from linked_fleet_gateway.resources.resource import Redirect, Resource
from linked_fleet_gateway.runtime.background import sliced


def check_preconditions(request: Request, resource: Resource) -> None:
    """Raise PreconditionFailed, except for stops. It may render every representation, so not for the event loop."""
    for _ in _checks(request, resource):
        pass


async def await_preconditions(request: Request, resource: Resource) -> None:
    """Check like ``check_preconditions``, giving other tasks turns."""
    async for _ in sliced(_checks(request, resource)):
        pass


async def present_under_preconditions(
    request: Request, resolve: Callable[[], Resource | Redirect | None]
) -> Resource | None:
    """Return the resource, whose preconditions hold for its state at the return; None if there is none."""
    while isinstance(resource := resolve(), Resource):
        before = _version(request, resource)
        await await_preconditions(request, resource)
        if isinstance(now := resolve(), Resource) and _version(request, now) == before:
            return now
    return None


def _version(request: Request, resource: Resource) -> str:
    conditional = field(request, "if-match") is not None or field(request, "if-none-match") is not None
    return next(request.services.representations.etags(resource, request.base), "") if conditional else ""


def _checks(request: Request, resource: Resource) -> Iterator[None]:
    """Check preconditions, yielding after each rendered representation."""
    wanted = field(request, "if-match")
    unwanted = None if request.method in ("GET", "HEAD", "OPTIONS") else field(request, "if-none-match")
    if (wanted is None and unwanted is None) or _stops(resource):
        return
    holds = False
    for tag in request.services.representations.etags(resource, request.base):
        if not_modified(unwanted, tag):
            raise PreconditionFailed("If-None-Match names the present state of the resource.")
        holds = holds or precondition_holds(wanted, {tag})
        if holds and unwanted is None:
            return
        yield
    if not holds:
        raise PreconditionFailed("The resource has changed since; none of the entity tags in If-Match is current.")


def _stops(resource: Resource) -> bool:
    affords = resource.affords
    return isinstance(affords, EndInvocation) or (isinstance(affords, Invoke) and not affords.offer.takes_body)
