"""Agents that do not answer delay no others, and the rate of requests is limited."""

from collections import Counter

import pytest

from linked_fleet_gateway.fleet.description_queue import BACKOFF_S, Bounds, DescriptionQueue

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
        queue.finished(name)
    assert len(queue) == 0


def test_a_robot_that_comes_is_asked_before_thousands_are_asked_again() -> None:
    queue = DescriptionQueue(BOUNDS)
    for number in range(5000):
        queue.add(f"silent{number}", 0)
    while first := drain(queue, 0):
        for name in first:
            queue.failed(name, 0)
    queue.add("genuine", 60)
    assert queue.take(60) == "genuine"


def test_questions_without_an_answer_leave_room_for_first_questions() -> None:
    queue = DescriptionQueue(BOUNDS)
    for number in range(100):
        queue.add(f"silent{number}", 0)
    while first := drain(queue, 0):
        for name in first:
            queue.failed(name, 0)
    held = [name for step in range(100) for name in drain(queue, 1 + step)]  # none of these is ever answered
    assert len(held) == BOUNDS.repeated
    queue.add("genuine", 200)
    assert drain(queue, 200) == ["genuine"]


def test_the_number_of_questions_at_once_is_bounded() -> None:
    queue = DescriptionQueue(BOUNDS)
    for number in range(100):
        queue.add(str(number), 0)
    assert len(drain(queue, 0)) == BOUNDS.open


def test_repeated_questions_have_a_rate_however_many_robots_are_silent() -> None:
    queue = DescriptionQueue(BOUNDS)
    for number in range(1000):
        queue.add(str(number), 0)
    asked = Counter[str]()
    for step in range(60_000):
        now_s = step / 100
        for name in drain(queue, now_s):
            asked[name] += 1
            queue.failed(name, now_s)
    assert asked.total() - 1000 == pytest.approx(600 * BOUNDS.repeats_hz, rel=0.1)


def test_one_silent_robot_is_asked_more_and_more_seldom() -> None:
    queue = DescriptionQueue(BOUNDS)
    queue.add("r", 0)
    times = []
    for step in range(100_000):
        for name in drain(queue, step / 100):
            times.append(step / 100)
            assert queue.failed(name, step / 100) == min(len(times), len(BACKOFF_S) + 1)
    assert times[1] == BACKOFF_S[0]
    assert times[-1] - times[-2] == BACKOFF_S[-1]


def test_a_robot_that_is_asked_for_anew_is_not_asked_twice_at_once() -> None:
    queue = DescriptionQueue(BOUNDS)
    queue.add("r", 0)
    assert queue.take(0) == "r"
    queue.discard("r")
    queue.add("r", 0)
    assert queue.take(0) is None
    assert queue.failed("r", 0) == 0
    assert queue.take(0) == "r"


def test_the_robot_to_forget_is_the_one_that_has_been_silent_most_often() -> None:
    queue = DescriptionQueue(BOUNDS)
    queue.add("new", 0)
    assert queue.victim() is None
    queue.add("silent", 0, asked=5)
    queue.add("slow", 0, asked=1)
    assert queue.victim() == "silent"
