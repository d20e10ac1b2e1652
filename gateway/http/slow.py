"""What a slow reader may cost, and when one that does not read at all is given up."""

import asyncio
from asyncio.transports import Transport

from gateway.http.tls import unsent

HIGH_WATER_BYTES = 64 * 1024
"""What may wait for one reader when a message is added; so a channel holds at most this and one message, and over TLS
as much again that is encrypted."""
STALL_S = 30.0


class StallWatch:
    """Drops a connection whose reader takes nothing for ``stall_s``, twice that at the latest, though bytes wait."""

    def __init__(self, transport: Transport, stall_s: float) -> None:
        self._transport, self._stall_s = transport, stall_s
        self._written = self._mark = 0
        self._timer: asyncio.TimerHandle | None = None

    def wrote(self, size: int) -> None:
        """So many bytes have been given to the transport."""
        self._written += size
        if self._timer is None:
            self.arm()

    def arm(self) -> None:
        """Look after the connection until nothing waits any more."""
        if self._timer is None:
            self._mark = self._written - unsent(self._transport)
            self._timer = asyncio.get_running_loop().call_later(self._stall_s, self._look)

    def stop(self) -> None:
        """The connection is gone; a timer would keep it in memory."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self) -> None:
        self._timer = None
        waiting = unsent(self._transport)
        if waiting and self._written - waiting <= self._mark:
            self._transport.abort()
        elif waiting:
            self.arm()
