"""Agents that do not answer delay no others, and the rate of requests is limited."""

from collections import Counter

import pytest

from linked_fleet_state.presence import (
    BACKOFF_S,
    FIRST_OPEN,
    PROMPT_S,
    SLOW_S,
    Bounds,
    DescriptionQueue,
)

BOUNDS = Bounds(open=8, repeated=2, repeats_hz=10)


def drain(queue: DescriptionQueue, now_s: float) -> list[str]:
    """Return all requests that may be sent now."""
    taken = []
    while (robot := queue.take(now_s)) is not None:
        taken.append(robot)
    return taken


def test_the_first_and_the_last_that_came_are_asked_in_turn() -> None:
    queue = DescriptionQueue(BOUNDS)
    for name in ("a", "b", "x", "c", "d"):
        queue.add(name, 0)
    queue.discard("x")
    assert drain(queue, 0) == ["a", "d", "b", "c"]
    for name in ("a", "b", "c", "d"):
        queue.complete(name, 0)
    assert len(queue) == 0


def test_a_robot_that_comes_is_asked_before_thousands_are_asked_again() -> None:
    queue = DescriptionQueue(BOUNDS)
    for number in range(5000):
        queue.add(f"silent{number}", 0)
    while first := drain(queue, 0):
        for name in first:
            queue.requeue(name, 0)
    queue.add("genuine", 60)
    assert queue.take(60) == "genuine"


def test_questions_without_an_answer_leave_room_for_first_questions() -> None:
    queue = DescriptionQueue(BOUNDS)
    for number in range(100):
        queue.add(f"silent{number}", 0)
    while first := drain(queue, 0):
        for name in first:
            queue.requeue(name, 0)
    held = [name for step in range(100) for name in drain(queue, 1 + step)]  # none of these is ever answered
    assert len(held) == BOUNDS.repeated
    queue.add("genuine", 200)
    assert drain(queue, 200) == ["genuine"]


def test_the_number_of_questions_at_once_is_bounded() -> None:
    queue = DescriptionQueue(BOUNDS)
    for number in range(100):
        queue.add(str(number), 0)
    assert len(drain(queue, 0)) == BOUNDS.open


def test_prompt_replies_raise_the_number_of_questions_at_once_and_slow_ones_bring_it_back() -> None:
    queue = DescriptionQueue(Bounds(open=4 * FIRST_OPEN, repeated=2, repeats_hz=10))
    for number in range(1000):
        queue.add(str(number), 0)
    waiting = drain(queue, 0)
    assert len(waiting) == FIRST_OPEN
    at_once = []
    for took_s in (PROMPT_S, PROMPT_S, PROMPT_S, SLOW_S, 2 * SLOW_S):
        for name in waiting:
            queue.complete(name, took_s)
        waiting = drain(queue, 0)
        at_once.append(len(waiting))
    assert at_once == [2 * FIRST_OPEN, 4 * FIRST_OPEN, 4 * FIRST_OPEN, 4 * FIRST_OPEN, FIRST_OPEN]


def test_a_question_without_a_reply_leaves_the_number_at_once_as_it_is() -> None:
    queue = DescriptionQueue(Bounds(open=4 * FIRST_OPEN, repeated=2, repeats_hz=10))
    for number in range(1000):
        queue.add(str(number), 0)
    for name in drain(queue, 0):
        queue.requeue(name, 2)
    assert len(drain(queue, 2)) == FIRST_OPEN


def test_repeated_questions_have_a_rate_however_many_robots_are_silent() -> None:
    queue = DescriptionQueue(BOUNDS)
    for number in range(1000):
        queue.add(str(number), 0)
    asked = Counter[str]()
    for step in range(60_000):
        now_s = step / 100
        for name in drain(queue, now_s):
            asked[name] += 1
            queue.requeue(name, now_s)
    assert asked.total() - 1000 == pytest.approx(600 * BOUNDS.repeats_hz, rel=0.1)


def test_one_silent_robot_is_asked_more_and_more_seldom() -> None:
    queue = DescriptionQueue(BOUNDS)
    queue.add("r", 0)
    times = []
    for step in range(100_000):
        for name in drain(queue, step / 100):
            times.append(step / 100)
            assert queue.requeue(name, step / 100) == min(len(times), len(BACKOFF_S) + 1)
    assert times[1] == BACKOFF_S[0]
    assert times[-1] - times[-2] == BACKOFF_S[-1]


def test_a_robot_that_is_asked_for_anew_is_not_asked_twice_at_once() -> None:
    queue = DescriptionQueue(BOUNDS)
    queue.add("r", 0)
    assert queue.take(0) == "r"
    queue.discard("r")
    queue.add("r", 0)
    assert queue.take(0) is None
    assert queue.requeue("r", 0) == 0
    assert queue.take(0) == "r"


def test_the_robot_to_forget_is_the_one_that_has_been_silent_most_often() -> None:
    queue = DescriptionQueue(BOUNDS)
    queue.add("new", 0)
    assert queue.most_failed() is None
    queue.add("silent", 0, asked=5)
    queue.add("slow", 0, asked=1)
    assert queue.most_failed() == "silent"
