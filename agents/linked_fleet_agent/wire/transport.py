"""Settings that the Zenoh sessions of agents and gateways have in common."""

from collections.abc import Mapping

GATEWAY_LEASE_MS = 2_500
"""Silence after which a gateway counts as gone: that of its connection and that of its heartbeat."""
HEARTBEAT_S = 0.5
"""From one heartbeat of a gateway to the next."""

TRANSPORT: Mapping[str, object] = {
    "scouting/multicast/enabled": False,
    # Batches that may wait for each neighbour. A command or an answer is one, and is lost where there is no room: with
    # the two that are zenoh's own a machine with more to do than processors loses some.
    "transport/link/tx/queue/size/data": 16,
    # Of each neighbour on the same machine 16 MB would be kept for ever, of one that was killed too (zenoh 1.10).
    "transport/shared_memory/enabled": False,
}
"""Settings of Zenoh, by path."""
