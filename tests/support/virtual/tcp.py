"""TCP in memory: listeners, connections and their flow control on one event loop, with the faults of a network."""

import asyncio
import itertools
import os
import socket
from collections.abc import Callable
from typing import Any, cast

from virtual.confined import Confined, confined

KERNEL_BYTES = 64 * 1024
"""Limit of sent and unread bytes before writes wait at the sender: what the kernels of both sides buffer."""
_PIECE_BYTES = 64 * 1024
_HIGH_WATER_BYTES = 64 * 1024

Factory = Callable[[], asyncio.BaseProtocol]


class Internet:
    """Addresses, and what listens there. ``names``: those that can be resolved."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = loop
        self.names: dict[str, list[str]] = {"localhost": ["127.0.0.1"]}
        self.unreachable: set[tuple[str, int]] = set()
        """Addresses that packets do not reach: a connection neither opens nor fails."""
        self._listeners: dict[tuple[str, int], tuple[Factory, Confined | None]] = {}
        self._ports = itertools.count(40_000)

    def port(self, host: str, port: int = 0) -> int:
        """Return a free port, or ``port`` if it is not 0. Raises OSError if it is taken."""
        port = port or next(self._ports)
        if (host, port) in self._listeners:
            raise OSError(98, f"{host}:{port} is taken")
        return port

    def listen(self, factory: Factory, host: str = "127.0.0.1", port: int = 0) -> int:
        """Listen at an address and return the port; 0 chooses one. Raises OSError if the port is taken."""
        port = self.port(host, port)
        process = confined()
        self._listeners[host, port] = factory, process
        if process is not None:
            process.on_kill[host, port] = lambda: self.close(port, host)
        return port

    def close(self, port: int, host: str = "127.0.0.1") -> None:
        """Stop listening; open connections stay open."""
        self._listeners.pop((host, port), None)
        process = confined()
        if process is not None:
            process.on_kill.pop((host, port), None)

    def look_up(self, host: Any, port: Any) -> list[Any]:
        """Like ``socket.getaddrinfo``. Raises socket.gaierror for an unknown name."""
        text = host.decode() if isinstance(host, bytes) else str(host)
        found = self.names.get(text, [text] if text.replace(".", "").isdigit() or ":" in text else [])
        if not found:
            raise socket.gaierror(socket.EAI_NONAME, f"{text} is not known")
        kinds = ((socket.AF_INET6 if ":" in each else socket.AF_INET, each) for each in found)
        return [(family, socket.SOCK_STREAM, socket.IPPROTO_TCP, "", (each, int(port))) for family, each in kinds]

    async def connect(
        self, factory: Factory, host: str, port: int, receive_bytes: int = KERNEL_BYTES, source: str = "127.0.0.1"
    ) -> tuple["MemoryTransport", Any]:
        """Open a connection. Raises ConnectionRefusedError if nothing listens."""
        address = self.look_up(host, port)[0][4]
        await asyncio.sleep(0)
        caller = confined()
        if caller is not None and caller.dead:
            raise ConnectionRefusedError(111, "the process is dead")
        if address in self.unreachable:
            await self.loop.create_future()
        if address not in self._listeners:
            raise ConnectionRefusedError(111, f"nothing listens at {host}:{port}")
        here = (source, next(self._ports))
        listening, process = self._listeners[address]
        client, server = factory(), listening() if process is None else process.run(listening)
        near = MemoryTransport(self, client, here, address, confined())
        far = MemoryTransport(self, server, address, here, process)
        near.join(far, receive_bytes)
        far.join(near, KERNEL_BYTES)
        client.connection_made(near)
        far.call(server.connection_made, far)
        return near, client


class Listener:
    """A listening socket, and the server made of it. It takes its port when it is created."""

    family, type, proto = socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP

    def __init__(self, internet: Internet, host: str = "127.0.0.1", port: int = 0) -> None:
        self._internet, self.host, self.port = internet, host, internet.port(host, port)

    @property
    def sockets(self) -> tuple["Listener"]:
        return (self,)

    def begin(self, factory: Factory) -> None:
        self._internet.listen(factory, self.host, self.port)

    def getsockname(self) -> tuple[str, int]:
        return self.host, self.port

    def close(self) -> None:
        self._internet.close(self.port, self.host)

    async def wait_closed(self) -> None:
        """Return at once."""


class MemoryTransport(asyncio.Transport):
    """One end of a connection. Bytes wait here, then in the kernel of the other end, until its protocol reads them."""

    def __init__(
        self,
        internet: Internet,
        protocol: asyncio.BaseProtocol,
        here: tuple[str, int],
        there: tuple[str, int],
        process: Confined | None,
    ) -> None:
        super().__init__({"sockname": here, "peername": there, "socket": _Socket(self, here, there)})
        self._internet, self._loop, self._protocol = internet, internet.loop, protocol
        self._unsent, self._arrived = bytearray(), bytearray()
        self._room = KERNEL_BYTES
        self._reading, self._writing_paused = True, False
        self._ending = self._ended_there = self._closing = self._lost = False
        self._high, self._low = _HIGH_WATER_BYTES, _HIGH_WATER_BYTES // 4
        self._due = False
        self._reset: ConnectionResetError | None = None
        self._process = process
        if process is not None:
            process.on_kill[self] = self.abort
        self.silent = False
        """If true, nothing sent here arrives, as behind an unplugged cable; it waits."""

    def join(self, other: "MemoryTransport", receive_bytes: int) -> None:
        self._other, self._room = other, receive_bytes

    def call(self, callback: Callable[..., object], *arguments: object) -> None:
        """Call in the context of the process that owns this end."""
        if self._process is None:
            callback(*arguments)
        else:
            self._process.run(callback, *arguments)

    def _call_soon(self, callback: Callable[..., object], *arguments: object) -> None:
        """Schedule in the context of the process that owns this end, which may be stopped."""
        self.call(self._loop.call_soon, callback, *arguments)

    # -- asyncio.Transport --------------------------------------------------------------------------------------------

    def get_protocol(self) -> asyncio.BaseProtocol:
        return self._protocol

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        self._protocol = protocol

    def is_closing(self) -> bool:
        return self._closing

    def is_reading(self) -> bool:
        return self._reading and not self._closing

    def pause_reading(self) -> None:
        self._reading = False

    def resume_reading(self) -> None:
        self._reading = True
        self._deliver_soon()

    def can_write_eof(self) -> bool:
        return True

    def get_write_buffer_size(self) -> int:
        return len(self._unsent)

    def get_write_buffer_limits(self) -> tuple[int, int]:
        return self._low, self._high

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        self._high = (4 * low if low is not None else _HIGH_WATER_BYTES) if high is None else high
        self._low = self._high // 4 if low is None else low
        self._pause_or_resume()

    def write(self, data: Any) -> None:
        if self._ending:
            raise RuntimeError("nothing can be written after the end")
        if self._reset is not None:
            self._call_soon(self._lose, self._reset)
        if self._closing or self._reset is not None:
            return
        self._unsent += data
        self._send()
        self._pause_or_resume()

    def writelines(self, list_of_data: Any) -> None:
        self.write(b"".join(list_of_data))

    def write_eof(self) -> None:
        self._ending = True
        self._send()

    def close(self) -> None:
        """Send what waits, then close."""
        if self._closing:
            return
        self._closing = self._ending = True
        self._send()
        if not self._unsent:
            self._call_soon(self._lose, None)

    def abort(self) -> None:
        """Drop what waits; the other end sees a reset."""
        if self._lost:
            return
        self._closing = True
        self._unsent.clear()
        self._call_soon(self._lose, None)
        if not self.silent:
            self._other._call_soon(self._other._reset_arrives)

    # -- what travels -------------------------------------------------------------------------------------------------

    def _send(self) -> None:
        """Move bytes to the other end as far as there is room."""
        other = self._other
        if self.silent or other._lost:
            if other._lost:
                self._unsent.clear()
            return
        piece = self._unsent[: max(0, other._room - len(other._arrived))]
        del self._unsent[: len(piece)]
        other._arrived += piece
        if self._ending and not self._unsent:
            self._loop.call_later(0, other._end_arrives)
        other._deliver_soon()

    def _end_arrives(self) -> None:
        self._ended_there = True
        self._deliver_soon()

    def _reset_arrives(self) -> None:
        """Lose the connection, after reading what arrived before."""
        self._reset = ConnectionResetError(104, "the connection was reset by the other end")
        if self._arrived and not self._closing and not self._unsent:
            self._deliver_soon()
        else:
            self._lose(self._reset)

    def _deliver_soon(self) -> None:
        if not self._due and (self._arrived or self._ended_there or self._reset is not None):
            self._due = True
            self._call_soon(self._deliver)

    def _deliver(self) -> None:
        self._due = False
        if self._lost or not self._reading:
            return
        if self._arrived and not self._closing:
            piece = bytes(self._arrived[:_PIECE_BYTES])
            del self._arrived[: len(piece)]
            _receive(self._protocol, piece)
            self._other._drained()
            self._deliver_soon()
        elif self._reset is not None:
            self._lose(self._reset)
        elif self._ended_there and not self._closing:
            self._ended_there = False
            if not cast(asyncio.Protocol, self._protocol).eof_received():
                self.close()

    def _drained(self) -> None:
        """Continue sending, because the other end has read."""
        if self._unsent or self._closing:
            self._call_soon(self._send_more)

    def _send_more(self) -> None:
        if self._unsent:
            self._send()
            self._pause_or_resume()
        if self._closing and not self._unsent:
            self._lose(None)

    def release(self) -> None:
        """Let what has waited since ``silent`` travel again."""
        self.silent = False
        self._send()

    def _pause_or_resume(self) -> None:
        size, protocol = len(self._unsent), cast(asyncio.Protocol, self._protocol)
        if size > self._high and not self._writing_paused:
            self._writing_paused = True
            protocol.pause_writing()
        elif size <= self._low and self._writing_paused:
            self._writing_paused = False
            protocol.resume_writing()

    def _lose(self, error: Exception | None) -> None:
        if not self._lost:
            self._lost = self._closing = True
            if self._process is not None:
                self._process.on_kill.pop(self, None)
            self._protocol.connection_lost(error)
            self._other._drained()

    def readable(self) -> bool:
        return bool(self._arrived or self._ended_there or self._reset or self._lost)


def _receive(protocol: asyncio.BaseProtocol, piece: bytes) -> None:
    if not isinstance(protocol, asyncio.BufferedProtocol):
        cast(asyncio.Protocol, protocol).data_received(piece)
        return
    while piece:
        buffer = memoryview(cast(Any, protocol.get_buffer(len(piece))))
        size = min(len(buffer), len(piece))
        buffer[:size] = piece[:size]
        protocol.buffer_updated(size)
        piece = piece[size:]


class _Socket:
    """The socket that libraries request from a transport. Its descriptor can be polled, but never written to."""

    family, type, proto = socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP
    _quiet = os.pipe()
    _ready = os.pipe()
    os.write(_ready[1], b".")

    def __init__(self, transport: MemoryTransport, here: tuple[str, int], there: tuple[str, int]) -> None:
        self._transport, self._here, self._there = transport, here, there

    def fileno(self) -> int:
        return (self._ready if self._transport.readable() else self._quiet)[0]

    def getsockname(self) -> tuple[str, int]:
        return self._here

    def getpeername(self) -> tuple[str, int]:
        return self._there

    def setsockopt(self, *option: object) -> None:
        """Do nothing: options have no effect in memory."""

    def getsockopt(self, *option: object) -> int:
        return 0
