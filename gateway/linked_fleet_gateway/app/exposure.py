"""Requirements of a gateway that other machines reach, unless settings waive them by name. Pure."""

from collections.abc import Collection, Sequence

EXPOSURES = ("plain-http", "anonymous", "plain-zenoh")
"""Words of LINKED_FLEET_ALLOW, each of which waives one requirement."""


def exposure_problems(
    *, exposed: bool, tls: bool, identities: bool, open_endpoints: Sequence[str], allowed: Collection[str]
) -> list[str]:
    """Return a sentence for each unmet requirement, which names the remedies.

    ``exposed`` means that HTTP is reachable beyond loopback; ``open_endpoints`` are Zenoh endpoints that other machines
    reach without authentication.
    """
    found = []
    if exposed and not tls and "plain-http" not in allowed:
        found.append(
            "without TLS whoever is on the way reads and changes everything: give LINKED_FLEET_TLS_CERT and "
            "LINKED_FLEET_TLS_KEY, listen on loopback, or say LINKED_FLEET_ALLOW=plain-http (behind a front with TLS)"
        )
    if exposed and not identities and "anonymous" not in allowed:
        found.append(
            "without identities anybody moves the robots: give LINKED_FLEET_IDENTITIES, listen on loopback, "
            "or say LINKED_FLEET_ALLOW=anonymous"
        )
    if open_endpoints and "plain-zenoh" not in allowed:
        found.append(
            f"anybody who reaches {', '.join(open_endpoints)} could be a robot or move one: listen on tls/… or quic/… "
            "with LINKED_FLEET_ZENOH_CA, …_CERT, …_KEY and …_ACCESS, on loopback, or nowhere (…_CONNECT to a router), "
            "or say LINKED_FLEET_ALLOW=plain-zenoh"
        )
    return found
