"""The base of connections of HTTP and of WebSockets: transport, bounded writer, pauses in both directions, tasks."""

import asyncio
from asyncio.transports import BaseTransport, Transport
from collections.abc import Callable, Coroutine
from typing import Any, Protocol, cast

from linked_fleet_server.connection_limits import STALL_S, BoundedWriter


class ServerState(Protocol):
    """The part of uvicorn's state of a server that is used here. It waits for ``connections`` and ``tasks``."""

    connections: set[Any]
    tasks: set[asyncio.Task[None]]
    default_headers: list[tuple[bytes, bytes]]
    """Header fields of all responses: the date."""


class Connection(asyncio.Protocol):
    """A connection that uvicorn knows. Messages of ASGI and shutdown are left to subclasses."""

    stall_s = STALL_S
    on_drained: Callable[[], None] | None = None
    """Called when most of the buffered bytes have been sent."""
    transport: Transport
    writer: BoundedWriter

    def __init__(self, state: ServerState) -> None:
        self.state = state
        self._may_write = asyncio.Event()
        self._may_write.set()
        self._reading_paused = False

    def connection_made(self, transport: BaseTransport) -> None:
        self.transport = cast(Transport, transport)
        self.writer = BoundedWriter(self.transport, self.stall_s)
        self.state.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self.state.connections.discard(self)
        self.writer.stop()
        self._may_write.set()

    def pause_writing(self) -> None:
        self._may_write.clear()
        self.writer.watch()

    def resume_writing(self) -> None:
        self._may_write.set()
        if self.on_drained is not None:
            self.on_drained()

    @property
    def writing_paused(self) -> bool:
        """True while too many bytes are buffered."""
        return not self._may_write.is_set()

    async def drain(self) -> None:
        """Wait until few bytes are buffered, or the connection is lost."""
        await self._may_write.wait()

    def pause_reading(self) -> None:
        if not self._reading_paused and not self.transport.is_closing():
            self._reading_paused = True
            self.transport.pause_reading()

    def resume_reading(self) -> None:
        if self._reading_paused:
            self._reading_paused = False
            self.transport.resume_reading()

    def start_task(self, work: Coroutine[Any, Any, None]) -> None:
        """Run in a task for which a shutdown waits."""
        task = asyncio.get_running_loop().create_task(work)
        self.state.tasks.add(task)
        task.add_done_callback(self.state.tasks.discard)


def address(transport: BaseTransport, name: str) -> tuple[str, int] | None:
    """Return host and port of one end, ``peername`` or ``sockname``; None for a socket without."""
    found = transport.get_extra_info(name)
    return (str(found[0]), int(found[1])) if isinstance(found, tuple) else None
