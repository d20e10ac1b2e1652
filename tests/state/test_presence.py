"""The number of stored tokens is bounded, per robot and in total."""

import pytest

from linked_fleet_state.presence import MAX_RUNS, MAX_UNDESCRIBED, Presence


def test_the_latest_runs_of_one_robot_are_kept() -> None:
    presence = Presence()
    presence.add(("other", 1))
    for run in range(5000):
        presence.add(("r", run))
    assert presence.runs("r") == set(range(5000 - MAX_RUNS, 5000))
    assert presence.add(("r", 3)) == ("r", 3)
    assert presence.runs("other") == {1}
    assert presence.incomplete


def test_robots_without_a_description_have_a_bound_and_others_have_not() -> None:
    presence = Presence()
    for number in range(MAX_UNDESCRIBED):
        presence.add((f"r{number}", 1))
    with pytest.raises(OverflowError):
        presence.add(("late", 1))
    presence.add(("known", 1), described=True)
    presence.describe("r7")
    presence.add(("late", 1))
    assert presence.undescribed_count == MAX_UNDESCRIBED


def test_tokens_that_go_leave_nothing() -> None:
    presence = Presence()
    for number in range(100):
        presence.add((f"r{number}", number))
    for number in range(100):
        presence.remove((f"r{number}", number))
    assert (presence.tokens, presence.undescribed_count, presence.incomplete) == (set(), 0, False)
