"""Time limits for requests; afterwards the connection is closed."""

import asyncio
import math
from collections.abc import Callable

HEAD_S = 10.0
"""For the header block of a request, and for a new connection to start one, in seconds."""
BODY_S = 30.0
"""For the whole body, in seconds. At most 256 KiB are read, so that this is ample."""
MAX_HEAD_BYTES = 16 * 1024
"""Limit of request line and header block; slightly more if they arrive at once."""


class Deadline:
    """One deadline at a time; setting the same one again does not postpone it.

    A connection has a single timer that checks the deadline when it fires, because requests are more frequent than
    that.
    """

    def __init__(self, passed: Callable[[], None], loop: asyncio.AbstractEventLoop | None = None) -> None:
        self._passed = passed
        self._loop = loop or asyncio.get_running_loop()
        self._for: object = None
        self._due_s = math.inf
        self._timer: asyncio.TimerHandle | None = None
        self._fires_s = math.inf

    def set(self, what: object, after_s: float) -> None:
        """Set the deadline of ``what``, replacing that of anything else."""
        if what != self._for:
            self._for = what
            self.again(after_s)

    def again(self, after_s: float) -> None:
        """Extend the present deadline after it has passed."""
        self._due_s = due_s = self._loop.time() + after_s
        if self._timer is None or self._fires_s > due_s:
            self._start()

    def clear(self) -> None:
        """Remove the deadline."""
        self._for, self._due_s = None, math.inf

    def close(self) -> None:
        """Remove the deadline and the timer, which would keep the connection in memory."""
        self.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _start(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._fires_s = self._due_s
        self._timer = self._loop.call_at(self._due_s, self._look)

    def _look(self) -> None:
        self._timer = None
        if self._due_s == math.inf:
            return
        if self._loop.time() < self._due_s:
            self._start()
        else:
            self._passed()
