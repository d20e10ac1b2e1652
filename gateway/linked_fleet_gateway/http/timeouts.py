"""How long a client may take to say what it wants; after that its connection is closed."""

import asyncio
from collections.abc import Callable

HEAD_S = 10.0
"""For the header block of a request, from its first byte, and for a connection to begin with one."""
BODY_S = 30.0
"""For the whole body, from the end of the header block. At most 256 KiB are read, so nobody honest needs it."""
MAX_HEAD_BYTES = 16 * 1024
"""Of request line and header block; somewhat more if they come at once."""


class Deadline:
    """One at a time, that of what is waited for; more of the same does not put it off."""

    def __init__(self, passed: Callable[[], None]) -> None:
        self._passed = passed
        self._for: object = None
        self._timer: asyncio.TimerHandle | None = None

    def set(self, what: object, after_s: float) -> None:
        """Of ``what``, which is compared; that of anything else is over."""
        if what != self._for:
            self.clear()
            self._for = what
            self._timer = asyncio.get_running_loop().call_later(after_s, self._passed)

    def again(self, after_s: float) -> None:
        """Of the same once more, when it has passed."""
        self._timer = asyncio.get_running_loop().call_later(after_s, self._passed)

    def clear(self) -> None:
        self._for = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
