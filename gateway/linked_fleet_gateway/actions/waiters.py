"""Waiting for conditions on invocations."""

import asyncio
from collections.abc import Callable

from linked_fleet_gateway.fleet.invocations import Invocation


class Waiters:
    """Wakes waiters at every change of their invocation."""

    def __init__(self) -> None:
        self._events: dict[str, asyncio.Event] = {}
        self._shutting_down = False

    def shut_down(self) -> None:
        """Release all optional waits, because this gateway ends and others continue."""
        self._shutting_down = True
        for event in self._events.values():
            event.set()
        self._events.clear()

    async def until_or_shutdown(
        self, invocation: Invocation, holds: Callable[[Invocation], bool], timeout_s: float
    ) -> bool:
        """Wait like ``until``, or until the gateway ends. Return True if the condition holds then."""
        await self.until(invocation, lambda one: self._shutting_down or holds(one), timeout_s)
        return holds(invocation)

    async def until(self, invocation: Invocation, holds: Callable[[Invocation], bool], timeout_s: float) -> bool:
        """Wait until the condition holds. Return False after ``timeout_s``."""
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
