"""The page of the audit says in words what was requested."""

import pytest

from linked_fleet_gateway.extensions.audit.page import described


@pytest.mark.parametrize(
    ("what", "path", "said"),
    [
        ("PUT", "/ur5/elbow/actions/rotate", "rotate elbow"),
        ("PUT", "/ur5/maximumSpeedScale", "set maximum speed scale of ur5"),
        ("subscribe", "/", "subscribe to the fleet"),
        ("DELETE", "/ur5/elbow/actions/rotate/invocations/6f1d2c3b-aaaa", "stop rotate elbow"),
        ("POST", "/world/objects", "add to world objects"),
        ("MISSION", "/mission-runs/0cdc393b#0.0", "take a step of a mission"),
        ("ORDER", "/queue/0cdc393b", "start an order of the queue"),
    ],
)
def test_a_request_is_described_in_words(what: str, path: str, said: str) -> None:
    assert described(what, path) == said
