"""Those who wait for something to become true of an invocation."""

import asyncio
from collections.abc import Callable

from linked_fleet_gateway.fleet.invocations import Invocation


class Waiting:
    """Each is woken by whatever becomes of the invocation that it waits for."""

    def __init__(self) -> None:
        self._events: dict[str, asyncio.Event] = {}
        self._hurried = False

    def hurry(self) -> None:
        """Have nobody wait who merely prefers to: this gateway ends, and others will know what becomes of it."""
        self._hurried = True
        for event in self._events.values():
            event.set()
        self._events.clear()

    async def at_leisure(self, invocation: Invocation, holds: Callable[[Invocation], bool], timeout_s: float) -> bool:
        """``until``, unless the gateway ends before: then whether it holds by now."""
        await self.until(invocation, lambda one: self._hurried or holds(one), timeout_s)
        return holds(invocation)

    async def until(self, invocation: Invocation, holds: Callable[[Invocation], bool], timeout_s: float) -> bool:
        """Return True if it holds; False when ``timeout_s`` passed before."""
        try:
            async with asyncio.timeout(timeout_s):
                while not holds(invocation):
                    await self._events.setdefault(invocation.id, asyncio.Event()).wait()
        except TimeoutError:
            return False
        return True

    def wake(self, invocation: Invocation) -> None:
        event = self._events.pop(invocation.id, None)
        if event is not None:
            event.set()
