"""Detection of stalls of this process: frozen, starved or suspended. What was asked of it meanwhile is old."""

import time

TICK_S = 0.25
HELD_S = 2.0
"""From which on robots may have given this gateway up, and hold."""
CATCH_UP_S = 0.25
"""Within which what waited in its connections is read."""


class Alertness:
    """By the monotonic clock, which a frozen process is told of as well."""

    def __init__(self) -> None:
        self._ticked_s = time.monotonic()
        self._resumed_s = -CATCH_UP_S

    async def tick(self) -> None:
        """Notice that this process runs; to be called every ``TICK_S``."""
        self._tick()

    def was_held_up(self) -> bool:
        """Now, or so recently that a request may have come before."""
        self._tick()
        return time.monotonic() - self._resumed_s < CATCH_UP_S

    def _tick(self) -> None:
        now_s = time.monotonic()
        if now_s - self._ticked_s > HELD_S:
            self._resumed_s = now_s
        self._ticked_s = now_s
