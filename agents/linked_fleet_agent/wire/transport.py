"""Zenoh settings that agents and gateways share."""

from collections.abc import Mapping

GATEWAY_LEASE_MS = 2_500
"""Silence after which a gateway counts as gone, for its connection and for its heartbeat."""
HEARTBEAT_S = 0.5
"""Period of the heartbeats of a gateway."""

TRANSPORT: Mapping[str, object] = {
    "scouting/multicast/enabled": False,
    # Batches that may wait for each neighbour. A command or reply takes one and is lost if there is no room; with
    # Zenoh's default of two, a busy machine loses some.
    "transport/link/tx/queue/size/data": 16,
    # Zenoh 1.10 would keep 16 MB for each neighbour on the same machine for ever, even after that was killed.
    "transport/shared_memory/enabled": False,
}
"""Zenoh settings by path."""
