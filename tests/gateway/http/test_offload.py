"""Long bodies are parsed outside the event loop, one after another, with a bounded queue."""

import asyncio
import threading

import pytest

from linked_fleet_base.errors import Busy
from linked_fleet_gateway.http.scheduling import MOST_WAITING, SHORT_BYTES, Offload


def test_short_work_is_done_at_once_and_long_work_in_a_thread() -> None:
    async def both() -> tuple[int, int]:
        offload = Offload()
        return await offload.run(threading.get_ident, SHORT_BYTES), await offload.run(
            threading.get_ident, SHORT_BYTES + 1
        )

    short, long = asyncio.run(both())
    assert short == threading.get_ident() != long


async def test_the_loop_goes_on_and_the_queue_is_bounded() -> None:
    """While one is parsed the loop runs, others wait, and one too many is refused."""
    offload, go_on = Offload(), threading.Event()
    waiting = [asyncio.create_task(offload.run(go_on.wait, SHORT_BYTES + 1)) for _ in range(MOST_WAITING)]
    await asyncio.sleep(0)
    with pytest.raises(Busy):
        await offload.run(go_on.wait, SHORT_BYTES + 1)
    assert await offload.run(lambda: 1, 1) == 1
    go_on.set()
    assert await asyncio.gather(*waiting) == [True] * MOST_WAITING
    assert await offload.run(lambda: 2, SHORT_BYTES + 1) == 2
