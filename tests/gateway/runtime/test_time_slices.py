"""Long work yields to other tasks every few milliseconds."""

import asyncio
import time

import pytest

from linked_fleet_gateway.runtime.background import SLICE_S, sliced


def test_others_go_on_each_time_that_a_slice_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, done, seen = 0.0, 0, list[int]()
    monkeypatch.setattr(time, "monotonic", lambda: now_s)

    async def other() -> None:
        while True:
            await asyncio.sleep(0)
            seen.append(done)

    async def test() -> None:
        nonlocal now_s, done
        task = asyncio.create_task(other())
        await asyncio.sleep(0)
        async for item in sliced(range(1, 11)):
            done = item
            now_s += SLICE_S * 0.4  # a slice is over after three items
        task.cancel()

    asyncio.run(test())
    assert (seen, done) == ([3, 6, 9], 10)
