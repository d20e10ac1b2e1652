"""The caller of an action, with the header fields of its request."""

from dataclasses import dataclass

from linked_fleet_gateway.identity.rights import ALL, View


@dataclass(frozen=True)
class Caller:
    """A caller. ``name`` is displayed; ``token`` is that of the control lease.

    ``key`` is an idempotency key, for the request with ``digest``. ``body`` is the validated body as N-Triples.
    ``stops`` are the robots that it may stop, ``sees`` those that it may know of. ``rule`` is the rule that acts for
    its creator, or empty.
    """

    name: str = ""
    token: str = ""
    key: str = ""
    digest: str = ""
    body: str = ""
    stops: View = ALL
    sees: View = ALL
    rule: str = ""
