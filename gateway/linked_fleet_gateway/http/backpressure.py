"""Back-pressure: bytes that may wait for a slow reader, and the time after which one is given up."""

import asyncio
import os
from asyncio.transports import Transport

from linked_fleet_gateway.http.tls import descriptor, unsent

HIGH_WATER_BYTES = 64 * 1024
"""Bytes that may wait for one reader when a message is added: a channel holds at most this and a message, and over TLS
as much again that is encrypted."""
STALL_S = 30.0


class Reader:
    """The peer of a connection, given up when it takes nothing for ``stall_s``, twice that at the
    latest, though bytes wait.

    Streams send here. That is done for each message and each reader, so that no other objects are looked at for it, and
    while nothing waits the bytes are given to the socket itself: uvloop keeps books of what is written in a turn of the
    event loop, which takes a tenth of the time for a message.
    """

    __slots__ = ("_file", "_stall_s", "_streaming", "_taken", "_timer", "_transport", "_waited", "_written")

    def __init__(self, transport: Transport, stall_s: float) -> None:
        self._transport, self._stall_s = transport, stall_s
        self._streaming = False
        self._file: int | None = None
        self._written = self._taken = 0
        self._waited = False
        self._timer: asyncio.TimerHandle | None = None

    # -- as a stream --------------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Take what is sent from now on, on a connection that is open."""
        # Paused from the byte on at which no more is taken, or nobody would tell of the room again.
        self._transport.set_write_buffer_limits(high=HIGH_WATER_BYTES - 1, low=HIGH_WATER_BYTES // 4)
        self._file = descriptor(self._transport)
        self._streaming = True
        self.watch()

    def finish(self) -> None:
        """Take nothing more."""
        self._streaming = False

    @property
    def written(self) -> int:
        """Bytes sent so far."""
        return self._written

    def writable(self) -> bool:
        transport = self._transport
        return (
            self._streaming
            and not transport.is_closing()
            and transport.get_write_buffer_size() < HIGH_WATER_BYTES
        )  # fmt: skip

    def send(self, data: bytes) -> bool:
        """Send it whole if that is ``writable()``; whether it was."""
        transport, sent = self._transport, 0
        if not self._streaming or transport.is_closing():  # then its descriptor can be another connection's
            return False
        if waiting := transport.get_write_buffer_size():
            if waiting >= HIGH_WATER_BYTES:
                return False
        elif (file := self._file) is not None:
            try:
                sent = os.write(file, data)
            except OSError:  # there is no room, or nobody: the transport sees to either
                sent = 0
        if sent != len(data):
            transport.write(data[sent:])
        self._written += len(data)
        return True

    # -- whether it reads ---------------------------------------------------------------------------------------------

    def watch(self) -> None:
        """Look after the connection as long as bytes wait, and as long as there is a stream."""
        if self._timer is None:
            self._waited = False
            self._look()

    def is_behind(self) -> bool:
        """Return True if bytes wait; if so, the watch sees from now on whether they are taken."""
        if not unsent(self._transport):
            return False
        self.watch()
        return True

    def stop(self) -> None:
        """The connection is gone; a timer would keep it in memory."""
        self._streaming = False
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self) -> None:
        self._timer = None
        waiting = unsent(self._transport)
        taken = self._written - waiting
        if waiting and self._waited and taken <= self._taken:
            self._transport.abort()
            return
        self._taken, self._waited = taken, waiting > 0
        if waiting or self._streaming:
            self._timer = asyncio.get_running_loop().call_later(self._stall_s, self._look)
