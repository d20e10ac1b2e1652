"""Limits of connections: their number, the time of requests, and buffered bytes.

A connection without a running request can be closed without harm. So if all places are taken, the one that has been
idle for longest is closed, unless its client still reads the last response. A new connection is refused only if none
can be closed, or if all places of its address are busy.

A connection whose request exceeds its time limits is closed. Back-pressure bounds the bytes that are buffered for slow
readers, and the time for which they may stall.
"""

import asyncio
import math
import os
import resource
from asyncio.transports import Transport
from collections import Counter
from collections.abc import Callable

from linked_fleet_server.tls import file_descriptor, unsent_bytes

_SPARE_FILES = 256  # for Zenoh, Redis, receivers of callbacks and the log


class Sockets:
    """The connections of a server, ``max_total`` in all and ``max_per_client`` each. Any hashable object can be one."""

    def __init__(self, max_total: int, max_per_client: int) -> None:
        self._most, self._most_of_one = max_total, max_per_client
        self._client: dict[object, str] = {}
        self._of: Counter[str] = Counter()
        self._idle: dict[object, Callable[[], bool]] = {}

    def __len__(self) -> int:
        return len(self._client)

    def register(self, connection: object, client: str) -> bool:
        """Register a connection, closing an idle one if necessary. Return False if there is no place."""
        full = len(self._client) >= self._most or self._of[client] >= self._most_of_one
        if full and not self._make_room(client):
            return False
        self._client[connection] = client
        self._of[client] += 1
        return True

    def mark_idle(self, connection: object, evict: Callable[[], bool]) -> None:
        """Mark a connection as idle; ``evict`` may be called to close it."""
        if connection in self._client:
            self._idle.setdefault(connection, evict)

    def mark_busy(self, connection: object) -> None:
        self._idle.pop(connection, None)

    def unregister(self, connection: object) -> None:
        """Remove a closed connection; may be repeated."""
        self._idle.pop(connection, None)
        client = self._client.pop(connection, None)
        if client is not None:
            self._of[client] -= 1
            if not self._of[client]:
                del self._of[client]

    def _make_room(self, client: str) -> bool:
        crowded = self._of[client] >= self._most_of_one
        for connection, give_way in self._idle.items():
            if (not crowded or self._client[connection] == client) and give_way():
                self.unregister(connection)
                return True
        if not self._of[client]:
            del self._of[client]
        return False


def limit_to_file_descriptors(connections: int) -> int:
    """Return ``connections``, or less if the process may open fewer files. The limit is raised to its maximum."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < hard:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    return max(1, min(connections, hard - _SPARE_FILES)) if hard != resource.RLIM_INFINITY else connections


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

    def __init__(self, on_expired: Callable[[], None], loop: asyncio.AbstractEventLoop | None = None) -> None:
        self._passed = on_expired
        self._loop = loop or asyncio.get_running_loop()
        self._for: object = None
        self._due_s = math.inf
        self._timer: asyncio.TimerHandle | None = None
        self._fires_s = math.inf

    def set(self, key: object, after_s: float) -> None:
        """Set the deadline of ``key``, replacing that of anything else."""
        if key != self._for:
            self._for = key
            self.extend(after_s)

    def extend(self, after_s: float) -> None:
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

    def begin_stream(self) -> None:
        """Start accepting messages, on an open connection."""
        # Writing is paused as soon as nothing more is accepted, because only a pause is followed by a notification of
        # free room.
        self._transport.set_write_buffer_limits(high=HIGH_WATER_BYTES - 1, low=HIGH_WATER_BYTES // 4)
        self._file = file_descriptor(self._transport)
        self._streaming = True
        self.watch()

    def end_stream(self) -> None:
        """Stop accepting messages."""
        self._streaming = False

    @property
    def bytes_written(self) -> int:
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

    # -- responses -----------------------------------------------------------------------------------------------------

    def write(self, data: bytes) -> None:
        """Write a part of a response, however much is buffered."""
        self._written += len(data)  # first, because a full buffer starts the monitor within ``write``
        self._transport.write(data)

    # -- slow readers ------------------------------------------------------------------------------------------------

    def watch(self) -> None:
        """Monitor the connection while bytes are buffered or a stream is open."""
        if self._timer is None:
            self._waited = False
            self._look()

    def has_unsent_bytes(self) -> bool:
        """Return True if bytes are buffered; the monitor then checks that they are read."""
        if not unsent_bytes(self._transport):
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
        waiting = unsent_bytes(self._transport)
        taken = self._written - waiting
        if waiting and self._waited and taken <= self._taken:
            self._transport.abort()
            return
        self._taken, self._waited = taken, waiting > 0
        if waiting or self._streaming:
            self._timer = asyncio.get_running_loop().call_later(self._stall_s, self._look)
