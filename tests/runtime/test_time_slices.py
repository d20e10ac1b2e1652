"""Long work yields to other tasks every few milliseconds."""

import asyncio
import time

import pytest

from linked_fleet_runtime.background import SLICE_S, Turns, time_sliced


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
        async for item in time_sliced(range(1, 11)):
            done = item
            now_s += SLICE_S * 0.4  # a slice is over after three items
        task.cancel()

    asyncio.run(test())
    assert (seen, done) == ([3, 6, 9], 10)


def test_turns_leave_others_between_them_and_end_with_the_work() -> None:
    order: list[str] = []

    async def main() -> None:
        left = [3, 2, 1]

        def work(_: float) -> bool:
            order.append(f"turn {left.pop(0)}")
            return bool(left)

        turns = Turns(work)
        turns.schedule()
        turns.schedule()
        for _ in range(4):
            await asyncio.sleep(0)
            order.append("other")

    asyncio.run(main())
    assert order == ["turn 3", "other", "turn 2", "other", "turn 1", "other", "other"]


def test_a_turn_that_a_thread_asks_for_is_taken_once_and_asks_for_no_other() -> None:
    taken: list[int] = []

    async def main() -> None:
        def work(_: float) -> bool:
            taken.append(1)
            turns.schedule()  # whether there is more to do is what it returns
            return False

        turns = Turns(work)
        await asyncio.to_thread(turns.waker())
        for _ in range(3):
            await asyncio.sleep(0)

    asyncio.run(main())
    assert taken == [1]


def test_threads_that_ask_for_turns_make_no_more_than_one_per_iteration() -> None:
    taken: list[int] = []

    async def main() -> None:
        def work(_: float) -> bool:
            taken[-1] += 1
            return True

        turns = Turns(work)
        wake = turns.waker()
        for _ in range(5):
            taken.append(0)
            wake()
            await asyncio.sleep(0)
        taken.append(0)

    asyncio.run(main())
    assert taken[:5] == [1] * 5


def test_turns_go_on_after_an_error() -> None:
    done: list[str] = []
    errors: list[object] = []

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: errors.append(context["exception"]))
        left: list[Exception | None] = [ValueError("a step"), None]

        def work(_: float) -> bool:
            if (error := left.pop(0)) is not None:
                raise error
            done.append("done")
            return bool(left)

        Turns(work).schedule()
        for _ in range(3):
            await asyncio.sleep(0)

    asyncio.run(main())
    assert done == ["done"] and [str(each) for each in errors] == ["a step"]
