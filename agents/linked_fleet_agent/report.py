"""Progress of motions: how often an agent tells it, and what it tells again to a gateway that came later. Pure."""

import math
from collections import deque
from collections.abc import Mapping
from itertools import islice

from linked_fleet_agent.motion import Outcome
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import WIRE_VERSION, Progress

PERIOD_NS = 200_000_000
# How ends are kept for gateways that were not there to hear of them.
KEPT_NS = 60_000_000_000
MAX_KEPT = 256
# A router may pass on that a gateway is there before what that listens for: then the first telling reaches nobody.
AGAIN_NS = 1_000_000_000
MAX_POSITIONS = 256


class Report:
    """The progress of the commands of one run of an agent; ``now_ns`` is its monotonic clock."""

    def __init__(self, incarnation: int) -> None:
        self._incarnation = incarnation
        self._ends: deque[tuple[int, bytes]] = deque(maxlen=MAX_KEPT)
        self._arrivals = 0
        self._due_ns = 0
        self._again_ns: int | None = None

    def write(self, outcome: Outcome, measured: Mapping[str, float], now_ns: int, wall_ns: int) -> bytes:
        """The message that says it; ends are remembered."""
        known = ((joint, measured[joint]) for joint in outcome.joints if math.isfinite(measured[joint]))
        progress = Progress(
            version=WIRE_VERSION,
            id=outcome.command_id,
            incarnation=self._incarnation,
            state=outcome.state,
            wall_ns=wall_ns,
            reason=outcome.reason[:1024],
            positions=dict(islice(known, MAX_POSITIONS)),
            progress=outcome.progress,
            successor=outcome.successor,
        )
        payload = codec.encode(progress)
        if outcome.state != "running":
            self._ends.append((now_ns, payload))
        return payload

    def repeat(self, arrivals: int, now_ns: int) -> list[bytes]:
        """The ends of late, at once if a gateway has arrived and a second later; what is under way is due then too."""
        if arrivals != self._arrivals:
            self._arrivals, self._due_ns, self._again_ns = arrivals, now_ns, now_ns + AGAIN_NS
        elif self._again_ns is None or now_ns < self._again_ns:
            return []
        else:
            self._again_ns = None
        return [payload for ended_ns, payload in self._ends if now_ns - ended_ns <= KEPT_NS]

    def due(self, now_ns: int) -> bool:
        """Return True if it is time to say again how far everything is."""
        if now_ns < self._due_ns:
            return False
        self._due_ns = now_ns + PERIOD_NS
        return True
