"""Exchange of commands with a single Redis server, on connections of redis-py.

It does without the pool and the pipelines of redis-py, which take most of the time of a command.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol

Command = tuple[str | bytes | int, ...]


class Connection(Protocol):
    """The part of redis-py's connections that is used here."""

    @property
    def is_connected(self) -> bool: ...

    async def connect(self) -> None: ...

    async def disconnect(self, nowait: bool = False) -> None: ...

    async def can_read(self) -> bool:
        """Return True if there are bytes to read, or the server has closed the connection."""

    async def send_packed_command(self, command: bytes) -> None: ...

    async def read_response(self) -> Any:
        """Return an answer. Raises the server's error, with which the connection stays usable."""


class Exchange:
    """Connections to one server; each exchange has one of them to itself.

    ``connect`` returns a new connection, ``response_callbacks`` are functions that convert answers by the name of their
    command, and ``response_error`` is the class of the server's errors.
    """

    def __init__(
        self,
        connect: Callable[[], Connection],
        response_callbacks: Mapping[str, Callable[[Any], Any]],
        response_error: type[Exception],
    ) -> None:
        self._connect, self._response_callbacks, self._response_error = connect, response_callbacks, response_error
        self._connections: list[Connection] = []
        self._idle: list[Connection] = []

    async def close(self) -> None:
        """Close all connections without waiting for the server, which may hang."""
        for connection in self._connections:
            await connection.disconnect(nowait=True)

    async def send(self, commands: Sequence[Command]) -> list[Any]:
        """Send commands at once. Return their answers in order, refusals among them."""
        connection = self._idle.pop() if self._idle else self._another()
        try:
            if connection.is_connected and await connection.can_read():  # nobody has asked for these bytes
                await connection.disconnect(nowait=True)
            if not connection.is_connected:
                await connection.connect()
            await connection.send_packed_command(pack_commands(commands))
            return [await self._answer(connection, str(command[0])) for command in commands]
        except BaseException:  # also cancellation: the next user would read answers to these commands
            await connection.disconnect(nowait=True)
            raise
        finally:
            self._idle.append(connection)

    def _another(self) -> Connection:
        connection = self._connect()
        self._connections.append(connection)
        return connection

    async def _answer(self, connection: Connection, name: str) -> Any:
        try:
            answer = await connection.read_response()
        except self._response_error as error:
            return error
        form = self._response_callbacks.get(name)
        return answer if form is None else form(answer)


def pack_commands(commands: Iterable[Command]) -> bytes:
    """Return the bytes of commands (RESP 2). Raises UnicodeEncodeError for a text that is no Unicode."""
    parts = list[bytes]()
    for command in commands:
        parts.append(b"*%d\r\n" % len(command))
        for word in command:
            content = word if isinstance(word, bytes) else str(word).encode()
            parts += b"$%d\r\n" % len(content), content, b"\r\n"
    return b"".join(parts)
