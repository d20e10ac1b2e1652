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
_BUFFER_BYTES = 16_384  # of the sockets of a slow proxy, like the queue of a slow link


class Proxy:
    """A proxy from ``port`` to ``target``. While it is cut nothing arrives, and sent data waits, as in TCP.

    With ``bytes_per_s`` it carries at most so much in either direction.
    """

    def __init__(self, target: int, port: int = 0, bytes_per_s: float | None = None) -> None:
        self._target, self._bytes_per_s = target, bytes_per_s
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
        server = self._loop.run_until_complete(asyncio.start_server(self._serve, sock=self._listen(), **self._limit))
        self.port = server.sockets[0].getsockname()[1]
        ready.set()
        self._loop.run_forever()
        server.close()
        self._loop.run_until_complete(_end_all())
        self._loop.close()

    def end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)

    def _listen(self) -> socket.socket:
        listening = socket.socket()
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if self._bytes_per_s is not None:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        listening.bind(("127.0.0.1", self.port))
        return listening

    @property
    def _limit(self) -> dict[str, int]:
        return {} if self._bytes_per_s is None else {"limit": _BUFFER_BYTES}

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.closing(writer):
            await self._open.wait()
            if self._broken.is_set():
                return
            try:
                far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._target, **self._limit)
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
        if self._bytes_per_s is not None:
            await self._carry_slowly(reader, writer, self._bytes_per_s)
        while piece := await reader.read(_PIECE_BYTES):
            await self._open.wait()
            await asyncio.sleep(self.delay_s)
            writer.write(piece)
            await writer.drain()
        await self._open.wait()

    async def _carry_slowly(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, bytes_per_s: float
    ) -> None:
        """Carry at a limited rate; ``delay_s`` delays each byte, but not the next one."""
        free_s = 0.0
        while piece := await reader.read(_BUFFER_BYTES // 4):
            await self._open.wait()
            free_s = max(free_s, self._loop.time()) + len(piece) / bytes_per_s
            await asyncio.sleep(free_s - self._loop.time())
            self._loop.call_later(self.delay_s, _write, writer, piece)
        await asyncio.sleep(self.delay_s)


def _write(writer: asyncio.StreamWriter, piece: bytes) -> None:
    if not writer.is_closing():
        writer.write(piece)


async def _end_all() -> None:
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


@contextlib.contextmanager
def proxy(target: int, bytes_per_s: float | None = None, delay_s: float = 0.0) -> Iterator[Proxy]:
    """Run a proxy to a loopback port."""
    found, ready = Proxy(target, bytes_per_s=bytes_per_s), threading.Event()
    found.delay_s = delay_s
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
