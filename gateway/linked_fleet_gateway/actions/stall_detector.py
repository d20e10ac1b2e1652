"""Detection of stalls of this process (frozen, starved or suspended), after which received requests are old."""

import time

TICK_S = 0.25
HELD_S = 2.0
"""Duration of a stall after which robots may have given up this gateway and hold."""
CATCH_UP_S = 0.25
"""Time in which messages buffered during a stall are read."""


class StallDetector:
    """Detects stalls by the monotonic clock, which advances while a process is frozen."""

    def __init__(self) -> None:
        self._ticked_s = time.monotonic()
        self._resumed_s = -CATCH_UP_S

    async def tick(self) -> None:
        """Record that this process runs; call it every ``TICK_S``."""
        self._tick()

    def stalled_recently(self) -> bool:
        """Return True during a stall, or so soon after one that a request may have arrived before its end."""
        self._tick()
        return time.monotonic() - self._resumed_s < CATCH_UP_S

    def _tick(self) -> None:
        now_s = time.monotonic()
        if now_s - self._ticked_s > HELD_S:
            self._resumed_s = now_s
        self._ticked_s = now_s
