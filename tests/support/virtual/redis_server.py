"""Valkey in memory: the commands of fakeredis behind a connection of the event loop, with the faults of a server.

It listens in the loop's ``internet``, so that redis-py connects, times out and parses answers as always. The clock is
``time.time``. Commands run deterministically, one after another in the order of their arrival.
"""

import asyncio
import hashlib
import time
from collections import deque
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any

from fakeredis import FakeServer
from fakeredis._commands import command
from fakeredis._helpers import NoResponse, SimpleError, SimpleString
from fakeredis._socket import FakeSocket
from fakeredis.model import ClientInfo

from virtual.confined import Confined
from virtual.tcp import Internet

_HANDSHAKE = (b"CLIENT", b"HELLO", b"AUTH", b"SELECT", b"PING")
_TICK_S = 1e-6  # rounding of the loop's clock
_DURABLE = {b"appendonly": b"yes", b"appendfsync": b"always"}


class RedisServer:
    """A server at ``url``, whose data persists as if each command were written to disk.

    ``latency_s`` passes before a command runs. ``replicas`` are online; ``lagging`` of them confirm nothing. An
    ``error`` such as ``"LOADING ..."`` answers all commands except those that open a connection.
    """

    def __init__(self, internet: Internet, port: int = 0) -> None:
        self._internet, self.loop = internet, internet.loop
        self.port = internet.listen(self._accept, port=port)
        self._process = Confined("redis")  # for all clients
        self.latency_s = 0.0
        self.replicas = self.lagging = 0
        self.error = ""
        self._sessions: list[_Session] = []
        self._arrived: deque[tuple[float, _Session, bytes]] = deque()
        self._hangs = False
        self._until_lost, self._losing = 0, b""
        self._blocked: dict[_Session, Callable[[], None]] = {}
        self._to_look = False
        self.lose_everything()

    @property
    def url(self) -> str:
        return f"redis://127.0.0.1:{self.port}"

    # -- faults -------------------------------------------------------------------------------------------------------

    def unreachable(self) -> None:
        """Cut all connections and refuse new ones, like a killed server; its data stays."""
        self._internet.close(self.port)
        self._hangs = False
        self._arrived.clear()
        self.cut()

    def reachable(self) -> None:
        self._internet.listen(self._accept, port=self.port)

    def cut(self) -> None:
        """Cut all connections; new ones are served."""
        for session in [*self._sessions]:
            session.close()

    def hang(self) -> None:
        """Read nothing more, like a stopped process. Connections open, and commands wait."""
        self._hangs = True

    def release(self) -> None:
        """Run the waiting commands, including those of clients that gave up."""
        self._hangs = False
        self._process.run(self._serve)

    def step_wall(self, by_s: float) -> None:
        """Step its wall clock forward or back; those of others stay."""
        self._process.step_wall(by_s)

    def lose_everything(self) -> None:
        """Forget all data and cut all connections, like a restarted server without a disk."""
        self.data = FakeServer(version=(9,), server_type="valkey", config=dict(_DURABLE))
        self._arrived.clear()
        self.cut()

    def fail_after_executing(self, nth: int = 1, containing: str = "") -> None:
        """Run the nth command from now and cut its connection instead of answering; 0 for none.

        Only commands with a word (such as a key or a script) that contains the text count; reads of news never do.
        """
        self._until_lost, self._losing = nth, containing.encode()

    # -- data, as a test asks for them --------------------------------------------------------------------------------

    def keys(self, pattern: str = "*", lasting: bool = False) -> list[str]:
        """Return the keys; ``lasting``: only those without an expiry."""
        database = self.data.dbs[0]
        database.time = self._process.run(time.time)
        names = [key.decode() for key in database if not lasting or database[key].expireat is None]
        return sorted(name for name in names if fnmatchcase(name, pattern))

    # -- connections --------------------------------------------------------------------------------------------------

    def _accept(self) -> "_Session":
        return _Session(self)

    def opened(self, session: "_Session") -> None:
        self._sessions.append(session)

    def closed(self, session: "_Session") -> None:
        """Forget a connection. Commands that it sent still run."""
        self._sessions.remove(session)
        self._blocked.pop(session, None)

    def received(self, session: "_Session", data: bytes) -> None:
        now_s = self.loop.time()
        due_s = max(now_s + self.latency_s, self._arrived[-1][0] if self._arrived else 0.0)
        self._arrived.append((due_s, session, data))
        self._process.run(self.loop.call_at, due_s, self._serve)

    def _serve(self) -> None:
        now_s = self.loop.time() + _TICK_S
        while self._arrived and not self._hangs and self._arrived[0][0] <= now_s:
            _, session, data = self._arrived.popleft()
            session.read(data)

    def loses_answer(self, words: list[bytes]) -> bool:
        """Return True if the answer to a command that runs now is to be lost."""
        if words[0].upper() in (*_HANDSHAKE, b"XREAD") or not any(self._losing in word for word in words):
            return False
        self._until_lost -= 1
        return self._until_lost == 0

    # -- commands that wait -------------------------------------------------------------------------------------------

    def block(self, session: "_Session", look: Callable[[], None]) -> None:
        self._blocked[session] = look

    def unblock(self, session: "_Session") -> None:
        self._blocked.pop(session, None)

    def changed(self) -> None:
        """Let blocked commands check again, once for all changes in one turn of the loop."""
        if self._blocked and not self._to_look:
            self._to_look = True
            self.loop.call_soon(self._look)

    def _look(self) -> None:
        self._to_look = False
        for look in [*self._blocked.values()]:
            look()


class _Session(FakeSocket, asyncio.Protocol):
    """One connection with RESP 2. Its commands are those of fakeredis and some that fakeredis lacks."""

    def __init__(self, owner: RedisServer) -> None:
        super().__init__(owner.data, 0, client_class=object, client_info=ClientInfo(resp=2, user="default"))
        self._owner = owner
        self._transport: Any = None

    # -- the transport ------------------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport
        self._owner.opened(self)

    def data_received(self, data: bytes) -> None:
        self._owner.received(self, data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._owner.closed(self)
        super().kill()

    def read(self, data: bytes) -> None:
        self._parser.send(data)

    def close(self) -> None:
        self._transport.close()

    def kill(self) -> None:
        """Close after CLIENT KILL, so that a connection that kills itself gets an answer."""
        self._owner.loop.call_soon(self.close)

    # -- commands -----------------------------------------------------------------------------------------------------

    def _process_command(self, fields: list[bytes]) -> None:
        self._loses = self._owner.loses_answer(fields)
        if self._owner.error and fields[0].upper() not in _HANDSHAKE:
            self.put_response(SimpleError(self._owner.error))
            return
        # a set: adding the same callback again has no effect
        self._server.dbs[0].add_change_callback(self._owner.changed)
        super()._process_command(fields)

    def _decode_result(self, result: Any) -> Any:
        return result

    def put_response(self, msg: Any) -> None:
        if self._loses:
            self._transport.abort()
        elif not self._transport.is_closing():
            self._transport.write(_encoded(msg))

    def _blocking(
        self, timeout: float | None, func: Callable[[bool], Any], shape: Callable[[Any], Any] | None = None
    ) -> Any:
        """Answer as soon as ``func`` finds something, or with nothing at the timeout.

        Later commands wait until then.
        """
        found = func(True)
        shaped = shape or (lambda result: result)
        if found is not None:
            return shaped(found)

        def look() -> None:
            if (later := func(False)) is not None:
                finish(later)

        def finish(later: Any = None) -> None:
            if timer is not None:
                timer.cancel()
            self._owner.unblock(self)
            self.put_response(shaped(later))
            self.resume()

        timer = self._owner.loop.call_later(timeout, finish) if timeout else None
        self.pause()
        self._owner.block(self, look)
        return NoResponse()

    def _get_server_runtime(self, server: FakeServer) -> Any:
        """Return the Lua runtime, with a function for scripts that fakeredis lacks."""
        runtime = super()._get_server_runtime(server)
        runtime.globals()[b"redis"][b"sha1hex"] = _sha1hex
        return runtime

    @command(name="INFO", fixed=(), repeat=(bytes,))
    def info(self, *sections: bytes) -> bytes:
        """Return the section on replication, whichever is requested."""
        replicas = [f"slave{n}:ip=127.0.0.1,port=0,state=online,offset=1,lag=0" for n in range(self._owner.replicas)]
        lines = ["# Replication", "role:master", f"connected_slaves:{self._owner.replicas}", *replicas]
        return "".join(f"{line}\r\n" for line in lines).encode()

    @command(name="WAIT", fixed=(bytes, bytes))
    def wait(self, replicas: bytes, timeout_ms: bytes) -> Any:
        confirming = self._owner.replicas - self._owner.lagging
        enough = confirming if confirming >= int(replicas) else None
        return self._blocking(int(timeout_ms) / 1000, lambda _: enough, lambda found: confirming)

    @command(name="CONFIG GET", fixed=(bytes,), repeat=(bytes,))
    def config_get(self, *patterns: bytes) -> list[bytes]:
        asked = [pattern.decode().lower() for pattern in patterns]
        config = sorted(self._server.config.items())
        found = [(name, value) for name, value in config if any(fnmatchcase(name.decode(), each) for each in asked)]
        return [part for pair in found for part in pair]


def _sha1hex(text: bytes) -> bytes:
    return hashlib.sha1(text).hexdigest().encode()


def _encoded(answer: Any) -> bytes:
    """Encode as RESP 2."""
    if answer is None:
        return b"$-1\r\n"
    if isinstance(answer, SimpleString):
        return b"+%s\r\n" % answer.value
    if isinstance(answer, SimpleError):
        return f"-{answer.value}\r\n".encode()
    if isinstance(answer, int):
        return b":%d\r\n" % answer
    if isinstance(answer, bytes):
        return b"$%d\r\n%s\r\n" % (len(answer), answer)
    if isinstance(answer, list):
        return b"*%d\r\n%s" % (len(answer), b"".join(map(_encoded, answer)))
    raise TypeError(f"{type(answer).__name__} is no answer")
