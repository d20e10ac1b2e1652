"""Periodic calls: begin at once, continue, propagate exceptions, and never repeat what was missed."""

import asyncio

import pytest

from linked_fleet_agent.pace import every
from serving import running_loop

pytestmark = pytest.mark.virtual
PERIOD_S = 0.02


async def test_calls_begin_at_once_and_repeat_until_cancelled() -> None:
    times, loop = list[float](), asyncio.get_running_loop()
    begin = loop.time()
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(4.5 * PERIOD_S):
            await every(PERIOD_S, lambda: times.append(loop.time()))
    await asyncio.sleep(3 * PERIOD_S)
    assert times == pytest.approx([begin + number * PERIOD_S for number in range(5)], rel=0, abs=1e-6)


async def test_an_exception_ends_the_repetition() -> None:
    calls = list[int]()

    def act() -> None:
        calls.append(1)
        if len(calls) == 3:
            raise ValueError("third")

    with pytest.raises(ValueError, match="third"):
        await every(PERIOD_S, act)
    assert len(calls) == 3


async def test_missed_calls_are_skipped() -> None:
    """After a stall of ten periods one call follows at once, not ten, and then those due."""
    times, loop = list[float](), running_loop()

    def act() -> None:
        times.append(loop.time())
        if len(times) == 2:
            loop.clock.advance_to(loop.time() + 10 * PERIOD_S)
        if len(times) == 6:
            raise EOFError

    with pytest.raises(EOFError):
        await every(PERIOD_S, act)
    assert [round((at - times[0]) / PERIOD_S, 3) for at in times] == [0, 1, 11, 11, 12, 13]
