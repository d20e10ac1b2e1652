"""The seam towards authentication: the bearer token is the core's, further schemes are those of extensions."""

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
    """A caller who is known; ``holds`` tells later whether the credentials are still good.

    ``on_page``: a page says who has logged in.
    """

    identity: Identity
    holds: Callable[[], bool] = _always
    on_page: bool = False


class Scheme(Protocol):
    """A way to say who asks, beside bearer tokens."""

    hint: str
    """One sentence that tells a client how."""

    async def authenticate(self, scope: Scope) -> Authenticated | None:
        """The caller by the credentials of this scheme; None for a request that has none.

        Raises Unauthenticated, ForeignOrigin, StoreAway, IssuerAway.
        """

    def has_page(self, path: str) -> bool:
        """Return True for a path that the scheme answers itself, whoever asks."""

    async def answer(self, scope: Scope, receive: Receive) -> Response:
        """Answer a request for such a path. The caller may be nobody."""

    def invitation(self, scope: Scope) -> Response | None:
        """The answer to a person who is not known and asked for a page; None for any other request."""
