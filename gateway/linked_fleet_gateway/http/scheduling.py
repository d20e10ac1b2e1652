"""Shares of the gateway's time: no client and no long body delays others, and nothing delays a stop.

Requests proceed in turns, so that a stop overtakes all waiting ones. The event loop runs all ready callbacks before it
polls again: a hundred simultaneous requests of some milliseconds each would delay a stop that arrives next. With turns
it polls between any two requests.

Long bodies are parsed and validated in a thread, and long ones are written there. Rates are limited by client: each
string that identifies a client has a token bucket.
"""

import asyncio
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Collection
from typing import TypeVar

from starlette.types import Scope

from linked_fleet_base.contributions import present
from linked_fleet_base.errors import Busy
from linked_fleet_gateway.http.arrival import arrival_of
from linked_fleet_gateway.resources.action_offer import action_definitions
from linked_fleet_server.addresses import network_of


def stop_segments() -> frozenset[str]:
    """Return the last path segments of actions that stop something."""
    return present().derived("segments of stops", _stop_segments)


def _stop_segments() -> frozenset[str]:
    return frozenset(each.segment for each in action_definitions() if each.is_stop) | {"cancel"}


def may_stop(scope: Scope) -> bool:
    """Return True for a request that stops robots if there is such an action at its path, slash at its end or not.

    It neither waits nor is counted before that is known.
    """
    return scope.get("method") == "POST" and scope["path"].rstrip("/").rpartition("/")[2] in stop_segments()


class StopPriority:
    """Grants one turn per iteration of the event loop; others wait in order of arrival.

    ``carriers`` are paths whose requests carry other requests in their bodies; they take their turn after reading.
    """

    def __init__(self, carriers: Collection[str] = ()) -> None:
        self._carriers = frozenset(carriers)
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._taken = False

    async def wait_unless_stop(self, scope: Scope) -> None:
        """Wait for the turn of a request; a stop does not wait."""
        if not may_stop(scope) and scope["path"].rstrip("/") not in self._carriers:
            await self.wait_for_turn()

    async def wait_for_turn(self) -> None:
        """Wait for the next turn."""
        if not self.try_take_turn():
            turn = asyncio.get_running_loop().create_future()
            self._waiting.append(turn)
            await turn

    def try_take_turn(self) -> bool:
        """Take the present turn if nobody has; return False if somebody has."""
        if self._taken:
            return False
        self._taken = True
        asyncio.get_running_loop().call_soon(self._next)
        return True

    def _next(self) -> None:
        while self._waiting and self._waiting[0].done():  # the waiting request was cancelled
            self._waiting.popleft()
        self._taken = bool(self._waiting)
        if self._taken:
            turn = self._waiting.popleft()
            turn.set_result(None)
            turn.get_loop().call_soon(self._next)


SHORT_BYTES = 1024
"""Bodies up to this length are processed on the event loop, in a few milliseconds at most."""
LONG_BYTES = SHORT_BYTES + 1
MOST_WAITING = 64
T = TypeVar("T")


class Offload:
    """One thread at a time, because the interpreter runs only one, and more would compete with the event loop."""

    def __init__(self, max_waiting: int = MOST_WAITING) -> None:
        self._most_waiting = max_waiting
        self._place = asyncio.Semaphore(1)
        self._waiting = 0

    async def run(self, work: Callable[[], T], size: int, inline_bytes: int = SHORT_BYTES) -> T:
        """Run ``work`` on this many bytes, directly if they are few. Raises Busy if too many calls wait.

        ``work`` must not use anything that the event loop changes.
        """
        if size <= inline_bytes:
            return work()
        if self._waiting >= self._most_waiting:
            raise Busy(f"{self._most_waiting} long bodies are being read; ask again.")
        self._waiting += 1
        try:
            async with self._place:
                return await asyncio.to_thread(work)
        finally:
            self._waiting -= 1


BURST_S = 10.0
"""Seconds for which unused requests are kept."""
MAX_CLIENTS = 10_000


class TokenBuckets:
    """Allows each client ``per_s`` requests on average, ``burst`` of them at once; unlimited if ``per_s`` is 0.

    Beyond ``MAX_CLIENTS`` the least recent clients are forgotten, which restores their whole burst.
    """

    def __init__(
        self, per_s: float, clock_s: Callable[[], float] = lambda: time.monotonic(), burst: float | None = None
    ) -> None:
        self._per_s, self._clock_s = per_s, clock_s
        self._most = max(1.0, per_s * BURST_S if burst is None else burst)
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, and the time of that count

    @property
    def is_limited(self) -> bool:
        """False if requests are unlimited."""
        return self._per_s > 0

    def take(self, client: str) -> float:
        """Return the seconds until the client may send; 0 if it may now, which is then counted."""
        if not self._per_s:
            return 0.0
        now_s = self._clock_s()
        left, at_s = self._left.pop(client, (self._most, now_s))
        left = min(self._most, left + (now_s - at_s) * self._per_s)
        allowed = left >= 1.0
        self._left[client] = (left - 1.0 if allowed else left, now_s)
        if len(self._left) > MAX_CLIENTS:
            self._left.popitem(last=False)
        return 0.0 if allowed else (1.0 - left) / self._per_s


def bucket_key(scope: Scope) -> str:
    """Return the identity of the caller, or without one its address."""
    name, client = arrival_of(scope).authenticated.identity.name, scope.get("client")
    return f"identity {name}" if name else network_of(client[0]) if client else ""
