"""If-Match and, for writes, If-None-Match (RFC 9110, 13.1.1 and 13.1.2)."""

from collections.abc import Callable, Iterator
from functools import partial

from linked_fleet_base.errors import PreconditionFailed
from linked_fleet_gateway.http.demands import stops
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.page_context import page_context
from linked_fleet_gateway.http.representation import names_state, precondition_holds
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.resource import Redirect, Resource


def check_preconditions(request: Request, resource: Resource) -> None:
    """Raise PreconditionFailed, except for stops. Call it in a thread, because it may render every representation."""
    check = _Check(request, resource)
    if check.needed and not any(map(check.is_decided_by, _etags(request, resource))):
        check.end()


async def await_preconditions(request: Request, resource: Resource) -> None:
    """Check like ``check_preconditions``, giving other tasks turns."""
    check, services = _Check(request, resource), request.services
    if not check.needed:
        return
    context = partial(page_context, request, resource.path)
    tags = services.representations.etags_interleaved(resource, request.base, context, services.writing_offload)
    async for tag in tags:
        if check.is_decided_by(tag):
            return
    check.end()


async def resolve_under_preconditions(
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
    return next(_etags(request, resource), "") if conditional else ""


def _etags(request: Request, resource: Resource) -> Iterator[str]:
    context = partial(page_context, request, resource.path)
    return request.services.representations.etags(resource, request.base, context)


class _Check:
    """The preconditions of one request, checked with the tags of one representation after the other."""

    def __init__(self, request: Request, resource: Resource) -> None:
        reads = request.method in ("GET", "HEAD", "OPTIONS")
        self._wanted, self._unwanted = field(request, "if-match"), None if reads else field(request, "if-none-match")
        self.needed = not (self._wanted is None and self._unwanted is None) and not stops(resource)
        self._holds = False

    def is_decided_by(self, tag: str) -> bool:
        """Return True if the preconditions hold whatever the other tags are. Raises PreconditionFailed."""
        if names_state(self._unwanted, tag):
            raise PreconditionFailed("If-None-Match names the present state of the resource.")
        self._holds = self._holds or precondition_holds(self._wanted, {tag})
        return self._holds and self._unwanted is None

    def end(self) -> None:
        """Raise PreconditionFailed if no tag has met If-Match."""
        if not self._holds:
            raise PreconditionFailed("The resource has changed since; none of the entity tags in If-Match is current.")
