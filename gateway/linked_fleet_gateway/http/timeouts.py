"""How long a client may take to say what it wants; after that its connection is closed."""

import asyncio
import math
from collections.abc import Callable

HEAD_S = 10.0
"""For the header block of a request, from its first byte, and for a connection to begin with one."""
BODY_S = 30.0
"""For the whole body, from the end of the header block. At most 256 KiB are read, so nobody honest needs it."""
MAX_HEAD_BYTES = 16 * 1024
"""Bytes of request line and header block; somewhat more if they come at once."""


class Deadline:
    """One at a time, that of what is waited for; more of the same does not put it off.

    A connection has one timer, which looks when it fires whether the time has come: requests come more often than that.
    """

    def __init__(self, passed: Callable[[], None], loop: asyncio.AbstractEventLoop | None = None) -> None:
        self._passed = passed
        self._loop = loop or asyncio.get_running_loop()
        self._for: object = None
        self._due_s = math.inf
        self._timer: asyncio.TimerHandle | None = None
        self._fires_s = math.inf

    def set(self, what: object, after_s: float) -> None:
        """Set the deadline of ``what``, which is compared; that of anything else is over."""
        if what != self._for:
            self._for = what
            self.again(after_s)

    def again(self, after_s: float) -> None:
        """Set the deadline of the same once more, when it has passed."""
        self._due_s = due_s = self._loop.time() + after_s
        if self._timer is None or self._fires_s > due_s:
            self._start()

    def clear(self) -> None:
        """Wait for nothing."""
        self._for, self._due_s = None, math.inf

    def close(self) -> None:
        """Wait for nothing any more; a timer would keep the connection in memory."""
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
