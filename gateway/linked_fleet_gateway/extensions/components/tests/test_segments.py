"""Segments of the actions of components."""

import pytest

from linked_fleet_gateway.extensions.components.offers import segment_of
from linked_fleet_gateway.http.scheduling import may_stop

_ACTIONS = [
    ("grasp", "grasp"),
    ("stop", "~73top"),
    ("hold", "~68old"),
    ("stopAll", "~73topAll"),
    ("cancel", "~63ancel"),
    ("in/out", "in~2Fout"),
]


@pytest.mark.parametrize(("name", "segment"), _ACTIONS)
def test_no_robot_declares_an_action_that_is_queued_and_counted_like_a_stop(name: str, segment: str) -> None:
    assert segment_of(name) == segment
    assert not may_stop({"type": "http", "method": "POST", "path": f"/cell/lamp/actions/{segment}"})
