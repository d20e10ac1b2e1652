"""A TCP proxy from one gateway to a server, in the test's event loop, with faults.

TCP guarantees neither that sent data arrives, nor that data of a lost connection did not arrive, nor that data written
together is read together. All of these happen here, depending on the seed.
"""

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator

_PIECE_BYTES = 65_536
_SPLIT_S = 0.001
"""Pause between the parts of one write, so that the server reads them separately."""


class _Connection:
    def __init__(self, client: asyncio.StreamWriter, server: asyncio.StreamWriter) -> None:
        self.client, self.server = client, server
        self.late_s: float | None = None
        self.deaf = False

    def abort(self) -> None:
        for writer in (self.client, self.server):
            writer.transport.abort()


class FaultyProxy:
    """A proxy from ``port`` to ``target``, which may be changed before ``reset``.

    ``split``: share of requests that the server reads in two parts.
    """

    def __init__(self, draws: random.Random, split: float = 0.0) -> None:
        self._draws, self._split = draws, split
        self._open = asyncio.Event()
        self._open.set()
        self._connections: set[_Connection] = set()
        self._serving: set[asyncio.Task[None]] = set()
        self._severed = False
        self.target = self.port = 0

    # -- faults -------------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Drop every connection with the data in transit."""
        for connection in list(self._connections):
            connection.abort()

    def lose_answers(self) -> None:
        """Drop every connection after its next request, which is executed without a visible answer."""
        for connection in self._connections:
            connection.deaf = True

    def make_late(self, late_s: float) -> None:
        """Drop every connection at its next request, which reaches the server only after ``late_s``."""
        for connection in self._connections:
            connection.late_s = late_s

    def cut(self) -> None:
        """Deliver nothing on any connection until ``heal``."""
        self._open.clear()

    def heal(self) -> None:
        self._open.set()

    def sever(self) -> None:
        """End for good, together with the gateway that used it."""
        self._severed = True
        self.reset()

    # -- traffic ------------------------------------------------------------------------------------------------------

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._serving.add(task)
        # Streams report a cancelled connection as an error.
        with contextlib.suppress(OSError, asyncio.CancelledError), contextlib.closing(writer):
            try:
                await self._carry(reader, writer)
            finally:
                self._serving.discard(task)

    async def end(self) -> None:
        for task in list(self._serving):
            task.cancel()
        await asyncio.gather(*self._serving, return_exceptions=True)

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._open.wait()
        if self._severed:
            return
        target = self.target
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", target)
        with contextlib.closing(far_writer):
            if target != self.target:  # a request to a replaced server would return old data
                return
            connection = _Connection(writer, far_writer)
            self._connections.add(connection)
            ways = [
                asyncio.create_task(self._ask(reader, connection)),
                asyncio.create_task(self._tell(far_reader, connection)),
            ]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                self._connections.discard(connection)
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)

    async def _ask(self, reader: asyncio.StreamReader, connection: _Connection) -> None:
        server = connection.server
        while piece := await reader.read(_PIECE_BYTES):
            await self._open.wait()
            if connection.late_s is not None:
                await self._send_late(piece, connection)
                return
            if len(piece) > 1 and self._draws.random() < self._split:
                first = self._draws.randrange(1, len(piece))
                server.write(piece[:first])
                await asyncio.sleep(_SPLIT_S)
                piece = piece[first:]
            server.write(piece)
            await server.drain()

    async def _send_late(self, piece: bytes, connection: _Connection) -> None:
        assert connection.late_s is not None
        connection.deaf = True
        connection.client.transport.abort()
        await asyncio.sleep(connection.late_s)
        connection.server.write(piece)
        await connection.server.drain()

    async def _tell(self, reader: asyncio.StreamReader, connection: _Connection) -> None:
        while piece := await reader.read(_PIECE_BYTES):
            await self._open.wait()
            if connection.deaf:
                if connection.late_s is None:
                    return
                continue
            connection.client.write(piece)
            await connection.client.drain()


@contextlib.asynccontextmanager
async def faulty_proxy(target: int, draws: random.Random, split: float = 0.0) -> AsyncIterator[FaultyProxy]:
    """Run a proxy to a loopback port."""
    way = FaultyProxy(draws, split)
    way.target = target
    server = await asyncio.start_server(way.serve, "127.0.0.1", 0)
    way.port = server.sockets[0].getsockname()[1]
    try:
        yield way
    finally:
        server.close()
        way.heal()
        await way.end()
