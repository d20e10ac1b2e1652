"""Back-pressure: limits of buffered bytes for slow readers, and of the time for which they may stall."""

import asyncio
import os
from asyncio.transports import Transport

from linked_fleet_gateway.http.tls import descriptor, unsent

HIGH_WATER_BYTES = 64 * 1024
"""Bytes that may be buffered for a reader when a message is added.

A channel buffers at most this and one message; over TLS as much again in encrypted form.
"""
STALL_S = 30.0


class BoundedWriter:
    """Sends to the peer of a connection, and disconnects it if it reads nothing while bytes wait.

    The peer has ``stall_s`` (at most twice that) to read some of them. Streams send through this object. While nothing
    is buffered, bytes are written to the socket directly: uvloop's bookkeeping of writes takes ten times as long as
    such a message.
    """

    __slots__ = ("_file", "_stall_s", "_streaming", "_taken", "_timer", "_transport", "_waited", "_written")

    def __init__(self, transport: Transport, stall_s: float) -> None:
        self._transport, self._stall_s = transport, stall_s
        self._streaming = False
        self._file: int | None = None
        self._written = self._taken = 0
        self._waited = False
        self._timer: asyncio.TimerHandle | None = None

    # -- streams -------------------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Start accepting messages, on an open connection."""
        # Writing is paused as soon as nothing more is accepted, because only a pause is followed by a notification of
        # free room.
        self._transport.set_write_buffer_limits(high=HIGH_WATER_BYTES - 1, low=HIGH_WATER_BYTES // 4)
        self._file = descriptor(self._transport)
        self._streaming = True
        self.watch()

    def finish(self) -> None:
        """Stop accepting messages."""
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
        """Send the bytes completely if ``writable()``. Return True if they were sent."""
        transport, sent = self._transport, 0
        if not self._streaming or transport.is_closing():  # the descriptor may then belong to another connection
            return False
        if waiting := transport.get_write_buffer_size():
            if waiting >= HIGH_WATER_BYTES:
                return False
        elif (file := self._file) is not None:
            try:
                sent = os.write(file, data)
            except OSError:  # no room or no peer: the transport handles both
                sent = 0
        if sent != len(data):
            transport.write(data[sent:])
        self._written += len(data)
        return True

    # -- slow readers ------------------------------------------------------------------------------------------------

    def watch(self) -> None:
        """Monitor the connection while bytes are buffered or a stream is open."""
        if self._timer is None:
            self._waited = False
            self._look()

    def is_behind(self) -> bool:
        """Return True if bytes are buffered; the monitor then checks that they are read."""
        if not unsent(self._transport):
            return False
        self.watch()
        return True

    def stop(self) -> None:
        """Stop monitoring a lost connection; a timer would keep it in memory."""
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
