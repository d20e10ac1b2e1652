"""The interface for authentication: bearer tokens belong to the core, further schemes to extensions."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from starlette.responses import Response
from starlette.types import Receive, Scope

from linked_fleet_gateway.identity.rights import Identity


def _always() -> bool:
    return True


@dataclass(frozen=True)
class Authenticated:
    """An authenticated caller; ``holds`` tells later if the credentials are still valid.

    ``on_page`` makes pages show who is logged in.
    """

    identity: Identity
    holds: Callable[[], bool] = _always
    on_page: bool = False


class Scheme(Protocol):
    """An authentication scheme besides bearer tokens."""

    hint: str
    """One sentence that tells a client how to authenticate."""

    async def authenticate(self, scope: Scope) -> Authenticated | None:
        """Return the caller by the credentials of this scheme; None for a request without any.

        Raises Unauthenticated, ForeignOrigin, StoreAway, IssuerAway.
        """

    def has_page(self, path: str) -> bool:
        """Return True for a path that the scheme serves itself, for everybody."""

    async def answer(self, scope: Scope, receive: Receive) -> Response:
        """Answer a request for such a path. The caller may be unauthenticated."""

    def invitation(self, scope: Scope) -> Response | None:
        """Return a response for an unauthenticated browser that requests a page; None for other requests."""
