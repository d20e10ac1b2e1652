"""Tasks end although they swallow a cancellation, and the waiting task can itself be cancelled."""

import asyncio

import pytest

from linked_fleet_runtime.background import cancel_tasks


class _Stubborn:
    """Ignores so many cancellations."""

    def __init__(self, swallows: float) -> None:
        self.swallows = swallows
        self.task = asyncio.create_task(self._run())

    async def _run(self) -> None:
        while True:
            try:
                await asyncio.sleep(3600)
            except asyncio.CancelledError:
                self.swallows -= 1
                if self.swallows < 0:
                    raise


async def test_a_swallowed_cancellation_is_repeated() -> None:
    tasks = [_Stubborn(swallows).task for swallows in range(3)]
    await asyncio.sleep(0)
    async with asyncio.timeout(20):
        await cancel_tasks(tasks)
    assert all(task.cancelled() for task in tasks)
    await cancel_tasks(tasks)  # nothing to do


async def test_ending_tasks_can_be_cancelled() -> None:
    stubborn = _Stubborn(float("inf"))
    await asyncio.sleep(0)
    ending = asyncio.create_task(cancel_tasks([stubborn.task]))
    await asyncio.sleep(0)
    ending.cancel()
    with pytest.raises(asyncio.CancelledError):
        await ending
    stubborn.swallows = 0
