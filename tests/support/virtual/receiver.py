"""A receiver of callbacks in memory, on virtual time."""

import asyncio
import contextlib

import h11

from receiver_behaviour import Answer, Behaviour, Seen
from virtual.loop import PATIENCE_S, VirtualLoop
from virtual.tcp import Listener

_CHUNK = b"x" * 65536


class MemoryReceiver(Behaviour):
    """A receiver at an address of the loop's internet that behaves like ``receivers.CallbackReceiver``."""

    def __init__(self, loop: VirtualLoop, host: str = "127.0.0.1", port: int = 0) -> None:
        super().__init__()
        self._loop = loop
        self.connections = 0
        self._listener = Listener(loop.internet, host, port)
        self._released = asyncio.Event()
        self._open: set[asyncio.StreamWriter] = set()
        loop.run(asyncio.start_server(self._serve, sock=self._listener))  # type: ignore[arg-type]

    @property
    def port(self) -> int:
        return self._listener.port

    def url(self, path: str = "/callback", host: str = "127.0.0.1") -> str:
        return f"http://{host}:{self.port}{path}"

    def wait(self, count: int, path: str | None = None, method: str | None = None) -> list[Seen]:
        """Wait until the log has so many entries, and return it."""
        self._loop.run_until(lambda: self._counts[path, method] >= count, f"{count} requests", PATIENCE_S)
        return self.log(path, method)

    def release(self) -> None:
        """Send the delayed responses, and delay no more."""
        self._released.set()

    def close(self) -> None:
        self.release()
        self._listener.close()
        for writer in self._open:
            writer.transport.abort()
        self._loop.run_for(0)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        self._open.add(writer)
        with contextlib.suppress(ConnectionError, h11.RemoteProtocolError):  # the gateway may disconnect at any time
            await self._converse(reader, writer)
        self._open.discard(writer)
        writer.close()

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        port = writer.get_extra_info("peername")[1]
        connection = h11.Connection(h11.SERVER)
        while True:
            request, body = None, b""
            while not isinstance(event := connection.next_event(), h11.EndOfMessage):
                if event is h11.NEED_DATA:
                    connection.receive_data(await reader.read(65_536))
                elif isinstance(event, h11.Request):
                    request = event
                elif isinstance(event, h11.Data):
                    body += bytes(event.data)
                else:
                    return
            assert request is not None
            fields = {name.decode(): value.decode() for name, value in request.headers}
            answer = self.take(Seen(request.method.decode(), request.target.decode(), fields, body, port))
            if not await self._answer(answer, connection, writer):
                return
            connection.start_next_cycle()

    async def _answer(self, answer: Answer, connection: h11.Connection, writer: asyncio.StreamWriter) -> bool:
        """Respond; return True if another request may come on this connection."""
        if answer.stalls:
            await self._released.wait()
        if answer.raw is not None:
            writer.write(answer.raw)
        if answer.raw is not None or answer.hangs_up:
            return False
        fields = [(name, value.encode("latin-1")) for name, value in answer.headers.items()]
        ends = not (answer.endless or answer.stalls_in_body)
        if ends and answer.status != 204:
            fields.append(("Content-Length", b"%d" % len(answer.body)))
        head = h11.Response(status_code=answer.status, headers=fields if ends else [*fields, ("Connection", b"close")])
        writer.write(connection.send(head) or b"")
        if answer.body:
            writer.write(connection.send(h11.Data(data=answer.body)) or b"")
        if answer.stalls_in_body:
            await self._released.wait()
        while answer.endless:
            writer.write(connection.send(h11.Data(data=_CHUNK)) or b"")
            await writer.drain()
            self.endless_bytes += len(_CHUNK)
        if ends:
            writer.write(connection.send(h11.EndOfMessage()) or b"")
        return ends and connection.our_state is h11.DONE
