"""Gateways as processes, accessed over HTTP."""

import asyncio
import contextlib
import json
import re
import signal
from collections.abc import Coroutine, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from histories.workload import Unanswered
from running import Process

AUTHORITY = "fleet.example"
"""Authority of all requests, so that responses and entity tags of all gateways agree."""
_TIMEOUT_S = 6.0
_TURTLE = {"content-type": "text/turtle"}
_FROZEN_S = 4.0  # longer than the lease of a gateway
_KEPT_S = 5.0  # a connection without requests; gateways close it after ten seconds
_STATUS = (200, 201, 204, 404, 409, 412, 422, 503, 504)


@dataclass(frozen=True)
class Answer:
    """Header names in lower case."""

    status: int
    headers: dict[str, str]
    text: str

    @property
    def problem(self) -> str:
        """The code of a problem document."""
        return str(self.said("type")).rpartition("#")[2]

    def said(self, name: str) -> Any:
        """Return a member of a problem document."""
        return json.loads(self.text)[name]


class HttpGateway:
    def __init__(self, port: int, command: Sequence[str]) -> None:
        self.port = port
        self._process = Process(
            [*command, "--port", str(port), "--public-url", f"http://127.0.0.1:{port},http://{AUTHORITY}"]
        )
        self._idle: list[tuple[float, asyncio.StreamReader, asyncio.StreamWriter]] = []
        """Open connections, each with the time of its last response."""

    @property
    def log(self) -> str:
        return self._process.output

    async def serving(self) -> None:
        await asyncio.to_thread(self._process.said, "serving")

    async def kill(self) -> None:
        self._process.send(signal.SIGKILL)
        await asyncio.to_thread(self._process.stop)
        self._close()

    async def freeze(self) -> None:
        """Freeze for longer than its lease, then continue."""
        self._process.send(signal.SIGSTOP)
        await asyncio.sleep(_FROZEN_S)
        self._process.send(signal.SIGCONT)

    async def stop(self) -> None:
        self._close()
        await asyncio.to_thread(self._process.stop)

    def _close(self) -> None:
        while self._idle:
            self._idle.pop()[2].close()

    def task(self, coroutine: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        return asyncio.create_task(coroutine)

    async def ask(self, method: str, path: str, body: str = "", **headers: str) -> Answer:
        """Return the response; raises Unanswered if there is none, or if the gateway does not know the outcome."""
        with contextlib.suppress(OSError, EOFError, TimeoutError):
            async with asyncio.timeout(_TIMEOUT_S):
                answer = await self._request(method, path, body.encode(), headers)
            assert answer.status in _STATUS, f"{method} {path}: {answer}"
            if answer.status != 503:
                return answer
        raise Unanswered(f"{method} {path}")

    async def _request(self, method: str, path: str, body: bytes, headers: Mapping[str, str]) -> Answer:
        if self._idle and self._idle[-1][0] < asyncio.get_running_loop().time() - _KEPT_S:
            self._close()  # the others were used before it
        if self._idle:
            _, reader, writer = self._idle.pop()
        else:
            reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        try:
            fields = {"host": AUTHORITY, "content-length": str(len(body))} | (_TURTLE if body else {}) | headers
            head = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in fields.items())
            writer.write(f"{method} {path} HTTP/1.1\r\n{head}\r\n".encode() + body)
            answer = await _answer(reader)
        except BaseException:
            writer.transport.abort()
            raise
        self._idle.append((asyncio.get_running_loop().time(), reader, writer))
        return answer


async def _answer(reader: asyncio.StreamReader) -> Answer:
    status, *lines = (await reader.readuntil(b"\r\n\r\n")).decode().splitlines()[:-1]
    headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in lines)}
    body = await reader.readexactly(int(headers.get("content-length", 0)))
    return Answer(int(status.split()[1]), headers, body.decode())


def last_segment(location: str) -> str:
    return location.rstrip("/").rpartition("/")[2]


def quoted(text: str, predicate: str) -> str:
    """Return the literal in a Turtle document about its resource."""
    found = re.search(rf'{predicate} "([^"]*)"', text)
    assert found, text
    return found[1]
