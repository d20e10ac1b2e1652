"""If-Match and, for writes, If-None-Match (RFC 9110, 13.1.1 and 13.1.2)."""

from starlette.requests import Request

from gateway.errors import PreconditionFailed
from gateway.graph.affordance import EndInvocation, Invoke
from gateway.graph.resource import Resource
from gateway.http.conditional import not_modified, precondition_holds
from gateway.http.fields import field
from gateway.http.representation import etags


def check_preconditions(request: Request, resource: Resource, base: str) -> None:
    """PreconditionFailed; never for what stops a robot."""
    wanted = field(request, "if-match")
    unwanted = None if request.method in ("GET", "HEAD", "OPTIONS") else field(request, "if-none-match")
    if (wanted is None and unwanted is None) or _stops(resource):
        return
    if not any(precondition_holds(wanted, {tag}) for tag in etags(resource, base)):
        raise PreconditionFailed("The resource has changed since; none of the entity tags in If-Match is current.")
    if any(not_modified(unwanted, tag) for tag in etags(resource, base)):
        raise PreconditionFailed("If-None-Match names the present state of the resource.")


def _stops(resource: Resource) -> bool:
    affords = resource.affords
    return isinstance(affords, EndInvocation) or (isinstance(affords, Invoke) and not affords.takes_body)
