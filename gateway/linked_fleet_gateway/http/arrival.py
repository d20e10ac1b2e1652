"""A request as known to all layers: each fact is determined once, and passed on in one object."""

from collections.abc import Mapping, MutableMapping, Sequence
from typing import Any

from linked_fleet_gateway.http.authentication import Authenticated
from linked_fleet_gateway.identity.rights import EVERYBODY

_KEY = "linked-fleet.arrival"
_ANYBODY = Authenticated(EVERYBODY)
Scope = MutableMapping[str, Any]


class Arrival:
    """The part of a request that does not depend on its resource; ``http/entrance.py`` fills it in."""

    __slots__ = ("authenticated", "base", "elsewhere", "fields", "internal")

    def __init__(self, fields: Mapping[bytes, bytes], *, internal: bool = False) -> None:
        self.fields = fields
        """Header fields by name in lower case; several lines are joined (RFC 9110, 5.3)."""
        self.base = ""
        """The public base URL used by the client, without a slash at its end."""
        self.elsewhere = False
        """True if the request comes from a page of another origin."""
        self.authenticated = _ANYBODY
        """The caller. Without configured identities, everybody has all rights."""
        self.internal = internal
        """True for a request of an extension on behalf of another request."""


def arrival_of(scope: Scope) -> Arrival:
    """Return the object of the request, which copies of its scope share."""
    found: Arrival | None = scope.get(_KEY)
    return arrive(scope) if found is None else found


def arrive(scope: Scope, *, internal: bool = False) -> Arrival:
    """Create the object of a request whose header fields are known."""
    found = scope[_KEY] = Arrival(_joined(scope["headers"]), internal=internal)
    return found


def fields_of(scope: Scope) -> Mapping[bytes, bytes]:
    """Return the header fields of a request (``Arrival.fields``)."""
    return arrival_of(scope).fields


def _joined(headers: Sequence[tuple[bytes, bytes]]) -> Mapping[bytes, bytes]:
    found = dict(headers)
    if len(found) != len(headers):
        found = {}
        for name, value in headers:
            found[name] = found[name] + b", " + value if name in found else value
    return found
