"""The query process of a gateway: started for the first query, updated before each, restarted after a crash, ended when
idle.
"""

import asyncio
import logging
import socket
import time
from asyncio.subprocess import DEVNULL
from collections.abc import Callable

from linked_fleet_gateway.base.errors import BadRequest, Busy, FleetError
from linked_fleet_gateway.extensions.query.contributions import contributions
from linked_fleet_gateway.extensions.query.errors import QueryTooCostly, ResultTooLarge
from linked_fleet_gateway.extensions.query.messages import (
    DONE,
    FORKED,
    PATIENCE,
    REFUSED,
    QueryRequest,
    Refusal,
    decode_refusal,
    encode,
)
from linked_fleet_gateway.extensions.query.snapshot import Feed
from linked_fleet_gateway.runtime.worker import Worker

log = logging.getLogger(__name__)

_BEGIN_S = 60.0  # time for the first snapshot of the whole fleet
_GRACE_S = 1.0
IDLE_S = 300.0
"""Idle seconds after which the process ends. Its RDF copy of the fleet takes more memory than the gateway."""
_CHUNK = 256 * 1024
# The process forks, and threads do not survive that; single queries do not need them.
_ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class QueryProcess:
    """The process and its feed; ``feed`` creates one for a process without any state."""

    def __init__(self, feed: Callable[[], Feed], idle_s: float = IDLE_S) -> None:
        self._new_feed, self._idle_s = feed, idle_s
        self._under_way = 0
        self._idle_timer: asyncio.TimerHandle | None = None
        self._ending: asyncio.Task[None] | None = None
        self._feed = feed()
        self._control: socket.socket | None = None
        self._worker = Worker("linked_fleet_gateway.extensions.query.worker", _ALONE)
        self._telling = asyncio.Lock()

    async def ask(self, make: Callable[[Feed], QueryRequest]) -> bytes:
        """Return the result of the query that ``make`` builds from the present snapshot. Raises FleetError."""
        self._under_way += 1
        try:
            return await self._ask(make)
        finally:
            self._under_way -= 1
            self._rest()

    async def _ask(self, make: Callable[[Feed], QueryRequest]) -> bytes:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            limit_s = await self._begin(make, ours, theirs)
            started = time.monotonic()
            answer = await _read_all(ours, limit_s * PATIENCE + _GRACE_S)
        return _result(answer, time.monotonic() - started >= limit_s)

    @property
    def running(self) -> bool:
        return self._control is not None

    async def close(self) -> None:
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        if self._control is not None:
            self._control.close()
            self._control = None
        await self._worker.end()

    def _rest(self) -> None:
        """Restart the idle timer."""
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        self._idle_timer = asyncio.get_running_loop().call_later(self._idle_s, self._end_idle)

    def _end_idle(self) -> None:
        self._ending = asyncio.create_task(self._close_idle())

    async def _close_idle(self) -> None:
        async with self._telling:
            if not self._under_way:
                await self.close()

    async def _begin(self, make: Callable[[Feed], QueryRequest], ours: socket.socket, theirs: socket.socket) -> float:
        """Start a query in the process. Return its time limit in seconds."""
        async with self._telling:
            try:
                control = await self._running()
                ask = make(self._feed)
                await _send(control, encode(ask), theirs)
                theirs.close()
                async with asyncio.timeout(_BEGIN_S):
                    first = await asyncio.get_running_loop().sock_recv(ours, 1)
                if first != FORKED:
                    raise ConnectionError("it ended")
                return ask.limit_s
            except (OSError, TimeoutError) as error:
                log.warning("the query process is started anew: %s", error)
                await self.close()
                raise Busy("Queries cannot be answered at this moment; ask again.") from error
            except BaseException:  # it has received a part of a message
                await self.close()
                raise

    async def _running(self) -> socket.socket:
        if self._control is not None and self._worker.running:
            return self._control
        await self.close()
        self._feed = self._new_feed()
        ours, theirs = socket.socketpair()
        with theirs:
            await self._worker.start(str(theirs.fileno()), contributions(), pass_fds=[theirs.fileno()], stdin=DEVNULL)
        ours.setblocking(False)
        self._control = ours
        return ours


async def _send(control: socket.socket, content: bytes, answer: socket.socket) -> None:
    """Send the length together with the answer socket, then the content. Earlier messages have been received."""
    socket.send_fds(control, [len(content).to_bytes(8)], [answer.fileno()])
    await asyncio.get_running_loop().sock_sendall(control, content)


async def _read_all(ours: socket.socket, patience_s: float) -> bytearray:
    content = bytearray()
    try:
        async with asyncio.timeout(patience_s):
            while chunk := await asyncio.get_running_loop().sock_recv(ours, _CHUNK):
                content += chunk
    except (TimeoutError, ConnectionError):
        content.clear()
    return content


def _result(answer: bytearray, late: bool) -> bytes:
    end, content = bytes(answer[-1:]), bytes(answer[:-1])
    if end == DONE:
        return content
    if end == REFUSED:
        raise _error(decode_refusal(content))
    if late:
        raise QueryTooCostly("The query took longer than it may. Ask of fewer robots, or with fewer open paths.")
    raise QueryTooCostly("The query took more memory than it may, or is too deep. Ask of fewer robots, or in parts.")


def _error(refusal: Refusal) -> FleetError:
    if refusal.reason == "wrong":
        return BadRequest(refusal.detail, line=refusal.line, column=refusal.column)
    if refusal.reason == "large":
        return ResultTooLarge(refusal.detail)
    return QueryTooCostly("The query takes more memory than it may. Ask of fewer robots, or in parts.")
