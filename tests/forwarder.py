"""A TCP proxy between two processes that a test can cut, slow down and heal, while connections stay open.

Run as a process with PORT and the target's port, it is a transparent reverse proxy.
"""

import asyncio
import contextlib
import socket
import struct
import sys
import threading
from collections.abc import Iterator

_PIECE_BYTES = 65_536


class Proxy:
    """A proxy from ``port`` to ``target``. While it is cut nothing arrives, and sent data waits, as in TCP."""

    def __init__(self, target: int, port: int = 0) -> None:
        self._target = target
        self._loop = asyncio.new_event_loop()
        self._open = asyncio.Event()
        self._open.set()
        self._broken = asyncio.Event()
        self._writers = set[asyncio.StreamWriter]()
        self.delay_s = 0.0
        self.port = port

    @property
    def endpoint(self) -> str:
        """The endpoint for Zenoh."""
        return f"tcp/127.0.0.1:{self.port}"

    def cut(self) -> None:
        self._loop.call_soon_threadsafe(self._open.clear)

    def heal(self) -> None:
        self._loop.call_soon_threadsafe(self._open.set)

    def reset(self) -> None:
        """Reset all connections at both ends, whether cut or not. New ones are accepted."""
        self._loop.call_soon_threadsafe(self._reset)

    def _reset(self) -> None:
        for writer in self._writers:
            # RST instead of FIN
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            writer.transport.abort()
        self._broken.set()
        self._broken.clear()

    def sever(self) -> None:
        """Close all connections, as if both processes had been killed, and accept no new ones."""
        self._loop.call_soon_threadsafe(self._broken.set)

    def run(self, ready: threading.Event) -> None:
        """Serve until ``end``."""
        server = self._loop.run_until_complete(asyncio.start_server(self._serve, "127.0.0.1", self.port))
        self.port = server.sockets[0].getsockname()[1]
        ready.set()
        self._loop.run_forever()
        server.close()
        self._loop.run_until_complete(_end_all())
        self._loop.close()

    def end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.closing(writer):
            await self._open.wait()
            if self._broken.is_set():
                return
            try:
                far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._target)
            except OSError:  # nothing listens, and the client notices that
                return
            with contextlib.closing(far_writer):
                self._writers |= {writer, far_writer}
                ways = [self._carry(reader, far_writer), self._carry(far_reader, writer), self._broken.wait()]
                tasks = [asyncio.create_task(way) for way in ways]
                try:
                    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                finally:
                    self._writers -= {writer, far_writer}
                    for task in tasks:
                        task.cancel()
                    await asyncio.gather(*tasks, return_exceptions=True)

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while piece := await reader.read(_PIECE_BYTES):
            await self._open.wait()
            await asyncio.sleep(self.delay_s)
            writer.write(piece)
            await writer.drain()
        await self._open.wait()


async def _end_all() -> None:
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


@contextlib.contextmanager
def proxy(target: int) -> Iterator[Proxy]:
    """Run a proxy to a loopback port."""
    found, ready = Proxy(target), threading.Event()
    thread = threading.Thread(target=found.run, args=(ready,))
    thread.start()
    try:
        ready.wait()
        yield found
    finally:
        found.end()
        thread.join()


class _Ready(threading.Event):
    def set(self) -> None:
        print("forwarding", flush=True)
        super().set()


if __name__ == "__main__":
    Proxy(int(sys.argv[2]), int(sys.argv[1])).run(_Ready())
