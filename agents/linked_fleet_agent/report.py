"""Progress messages of motions: their period, and their repetition for gateways that arrive later. Pure."""

import math
from collections import deque
from collections.abc import Mapping
from itertools import islice

from linked_fleet_agent.motion import Outcome
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import WIRE_VERSION, Progress

PERIOD_NS = 200_000_000
# How long ends are kept for gateways that were not present.
KEPT_NS = 60_000_000_000
MAX_KEPT = 256
# A router may announce a gateway before its subscriptions, so that the first message reaches nobody.
AGAIN_NS = 1_000_000_000
MAX_POSITIONS = 256


class Report:
    """Progress of the commands of one run of an agent; ``now_ns`` is its monotonic clock."""

    def __init__(self, incarnation: int) -> None:
        self._incarnation = incarnation
        self._ends: deque[tuple[int, bytes]] = deque(maxlen=MAX_KEPT)
        self._arrivals = 0
        self._due_ns = 0
        self._again_ns: int | None = None

    def write(self, outcome: Outcome, measured: Mapping[str, float], now_ns: int, wall_ns: int) -> bytes:
        """Return the progress message for ``outcome``. Ends are kept for ``repeat``."""
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
        """Return the recent ends: at once if a gateway has arrived, and again a second later.

        Running motions are due then too.
        """
        if arrivals != self._arrivals:
            self._arrivals, self._due_ns, self._again_ns = arrivals, now_ns, now_ns + AGAIN_NS
        elif self._again_ns is None or now_ns < self._again_ns:
            return []
        else:
            self._again_ns = None
        return [payload for ended_ns, payload in self._ends if now_ns - ended_ns <= KEPT_NS]

    def due(self, now_ns: int) -> bool:
        """Return True if the progress of running motions is due."""
        if now_ns < self._due_ns:
            return False
        self._due_ns = now_ns + PERIOD_NS
        return True
