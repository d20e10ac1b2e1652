"""A request as known to all layers, and the interface of schemes that authenticate it.

Each fact of a request is determined once, and passed on in one object. Bearer tokens belong to the core, further
schemes to extensions.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from starlette.responses import Response
from starlette.types import Receive, Scope

from linked_fleet_identity.rights import EVERYBODY, Identity
from linked_fleet_server.message_heads import FIELDS, join_fields


def _always() -> bool:
    return True


@dataclass(frozen=True)
class Authenticated:
    """An authenticated caller; ``is_valid`` tells later if the credentials are still valid.

    ``shown_on_pages`` makes pages show who is logged in.
    """

    identity: Identity
    is_valid: Callable[[], bool] = _always
    shown_on_pages: bool = False


class Scheme(Protocol):
    """An authentication scheme besides bearer tokens."""

    hint: str
    """One sentence that tells a client how to authenticate."""

    async def authenticate(self, scope: Scope) -> Authenticated | None:
        """Return the caller by the credentials of this scheme; None for a request without any.

        Raises Unauthenticated, ForeignOrigin, RedisUnavailable, IssuerDown.
        """

    def has_page(self, path: str) -> bool:
        """Return True for a path that the scheme serves itself, for everybody."""

    async def answer(self, scope: Scope, receive: Receive) -> Response:
        """Answer a request for such a path. The caller may be unauthenticated."""

    def login_response(self, scope: Scope) -> Response | None:
        """Return a response for an unauthenticated browser that requests a page; None for other requests."""


_KEY = "linked-fleet.arrival"
_ANYBODY = Authenticated(EVERYBODY)


class Arrival:
    """The part of a request that does not depend on its resource; ``http/entrance.py`` fills it in."""

    __slots__ = (
        "authenticated",
        "base",
        "cross_origin",
        "decided",
        "fields",
        "internal",
        "is_plain_read",
        "rate_counted",
    )

    def __init__(self, fields: Mapping[bytes, bytes], *, internal: bool = False) -> None:
        self.fields = fields
        """Header fields by name in lower case; several lines are joined (RFC 9110, 5.3)."""
        self.base = ""
        """The public base URL used by the client, without a slash at its end."""
        self.cross_origin = False
        """True if the request comes from a page of another origin."""
        self.decided = False
        """True once it is known that its reply needs waiting, or what the reply is."""
        self.rate_counted = False
        """True once the request counts for the rate of its client."""
        self.authenticated = _ANYBODY
        """The caller. Without configured identities, everybody has all rights."""
        self.is_plain_read: bool | None = None
        """True if it asks for no more than a representation, False if for more; None until somebody wants to know."""
        self.internal = internal
        """True for a request of an extension on behalf of another request."""

    @property
    def names_event_stream(self) -> bool:
        """True if Accept names the media type of event streams, in any case (RFC 9110, 8.3.1).

        ``streams.wants_events`` compares its weight with that of other types.
        """
        return b"text/event-stream" in self.fields.get(b"accept", b"").lower()


def arrival_of(scope: Scope) -> Arrival:
    """Return the object of the request, which copies of its scope share."""
    found: Arrival | None = scope.get(_KEY)
    return create_arrival(scope) if found is None else found


def create_arrival(scope: Scope, *, internal: bool = False) -> Arrival:
    """Create the object of a request whose header fields are known."""
    fields = scope.get(FIELDS)  # the server has joined them
    found = scope[_KEY] = Arrival(join_fields(scope["headers"]) if fields is None else fields, internal=internal)
    return found
