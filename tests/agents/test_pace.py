"""What is done so often: at once and on, what it raises, and nothing twice for what was missed."""

import asyncio
import time

import pytest

from agents.pace import every

PERIOD_S = 0.02


async def _five_times() -> None:
    loop, times, enough = asyncio.get_running_loop(), list[float](), asyncio.Event()

    def act() -> None:
        times.append(loop.time())
        if len(times) == 5:
            enough.set()

    begin = loop.time()
    task = asyncio.create_task(every(PERIOD_S, act))
    await enough.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    # A timer may be late, but is never early by more than the clock's resolution.
    assert all(at >= begin + number * PERIOD_S - 1e-3 for number, at in enumerate(times))
    done = len(times)
    await asyncio.sleep(3 * PERIOD_S)  # for who is cancelled does no more
    assert len(times) == done


def test_it_is_done_at_once_and_then_so_often() -> None:
    asyncio.run(_five_times())


def test_what_it_raises_ends_it() -> None:
    calls = list[int]()

    def act() -> None:
        calls.append(1)
        if len(calls) == 3:
            raise ValueError("third")

    with pytest.raises(ValueError, match="third"):
        asyncio.run(every(PERIOD_S, act))
    assert len(calls) == 3


def test_what_was_missed_is_not_made_up() -> None:
    """After a stall of ten periods one call follows at once, not ten."""
    times = list[float]()

    def act() -> None:
        times.append(time.monotonic())
        if len(times) == 2:
            time.sleep(10 * PERIOD_S)
        if len(times) == 6:
            raise EOFError

    with pytest.raises(EOFError):
        asyncio.run(every(PERIOD_S, act))
    assert times[5] >= times[0] + (11 + 2) * PERIOD_S - 1e-3
