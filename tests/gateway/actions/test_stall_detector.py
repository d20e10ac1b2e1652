"""A process notices by its own clock that it was stopped."""

import pytest

from linked_fleet_gateway.actions import refusals
from linked_fleet_gateway.actions.refusals import CATCH_UP_S, HELD_S, StallDetector


def test_a_stall_counts_for_a_while_after_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr(refusals.time, "monotonic", lambda: now_s)
    one = StallDetector()
    for pause_s, held in (
        (0.3, False),
        (HELD_S + 0.1, True),
        (CATCH_UP_S / 2, True),
        (CATCH_UP_S, False),
        (0.3, False),
    ):
        now_s += pause_s
        assert one.stalled_recently() is held, pause_s
