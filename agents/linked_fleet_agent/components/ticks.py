"""Waiting of actions for the next tick of an agent or of a simulation."""

import asyncio


class Ticks:
    """Lets coroutines wait until ``happen`` is called the next time. For one event loop."""

    def __init__(self) -> None:
        self._waiting: list[asyncio.Future[None]] = []

    @property
    def awaited(self) -> bool:
        return bool(self._waiting)

    def happen(self) -> None:
        """Let those go on who wait."""
        waiting, self._waiting = self._waiting, []
        for each in waiting:
            if not each.done():
                each.set_result(None)

    async def next(self) -> None:
        """Wait until it happens the next time."""
        self._waiting.append(asyncio.get_running_loop().create_future())
        await self._waiting[-1]
