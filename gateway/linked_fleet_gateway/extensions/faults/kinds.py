"""The kinds of faults that gateways find themselves, and how each is debounced."""

from collections.abc import Mapping

from linked_fleet_gateway.extensions.faults.signal import Policy

LOW_PERCENT, EMPTY_PERCENT = 15.0, 5.0
"""Charges below which a battery is a warning, and an error."""
SILENT_S = 10.0
"""Time without a message of an agent that is present."""
CLOCK_S = 2.0
"""Difference between the clocks of an agent and of the gateway."""
SETTLING_S = 3.0
"""Time after the end of a motion in which its robot may still move."""
EFFORT = 1.05
"""Share of its declared effort that a joint may use."""

_STATE, _SLOW = Policy(confirm_s=1.0, clear_s=3.0), Policy(confirm_s=5.0, clear_s=10.0)
POLICIES: Mapping[str, Policy] = {
    "offline": Policy(confirm_s=5.0, clear_s=2.0),
    "silent": Policy(confirm_s=2.0, clear_s=2.0),
    "clock": _SLOW,
    "limits": Policy(confirm_s=0.0, clear_s=2.0),
    "effort": Policy(confirm_s=1.0, clear_s=5.0),
    "battery": Policy(confirm_s=5.0, clear_s=30.0),
    "stale": _SLOW,
    "protective-stop": Policy(confirm_s=0.0, clear_s=1.0),
    "uncommanded": Policy(confirm_s=3.0, clear_s=10.0),
}


def policy_of(kind: str) -> Policy:
    """Return how a kind of fault is debounced."""
    return POLICIES.get(kind, _STATE)
