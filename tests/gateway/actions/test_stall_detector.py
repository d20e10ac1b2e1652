"""A process notices by its own clock that it was stopped."""

import pytest

from linked_fleet_gateway.actions import refusals
from linked_fleet_gateway.actions.refusals import CATCH_UP_S, STALL_S, StallDetector


def test_a_stall_counts_for_a_while_after_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr(refusals.time, "monotonic", lambda: now_s)
    one = StallDetector()
    for pause_s, held in (
        (0.3, False),
        (STALL_S + 0.1, True),
        (CATCH_UP_S / 2, True),
        (CATCH_UP_S, False),
        (0.3, False),
    ):
        now_s += pause_s
        assert one.stalled_recently() is held, pause_s


@pytest.mark.parametrize(("pause_s", "counts"), [(STALL_S - 0.1, True), (STALL_S + 0.1, False)])
def test_time_with_a_stall_in_it_does_not_count(pause_s: float, counts: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even long after the stall; and what begins after it counts again."""
    now_s = 100.0
    monkeypatch.setattr(refusals.time, "monotonic", lambda: now_s)
    monkeypatch.setattr(refusals.time, "monotonic_ns", lambda: round(now_s * 1e9))
    one, began_ns = StallDetector(), round(now_s * 1e9)

    def run(seconds: float) -> None:
        nonlocal now_s
        now_s += seconds
        one.stalled_recently()

    run(1.0)
    assert one.elapsed_ns(began_ns) == 1_000_000_000
    run(pause_s)
    for _ in range(20):
        run(0.25)
    assert one.elapsed_ns(began_ns) == (round((6.0 + pause_s) * 1e9) if counts else 0)
    later_ns = round(now_s * 1e9)
    run(0.5)
    assert one.elapsed_ns(later_ns) == 500_000_000
