"""Random faults of position sensors, and orders given meanwhile, for properties of whatever sends setpoints."""

import math
from typing import NamedTuple

from hypothesis import strategies as st

KINDS = ("none", "outlier", "zeros", "seam", "shift", "noise", "freeze", "unknown")


class Event(NamedTuple):
    """For so many ``cycles`` a sensor has a fault of a ``kind`` and ``size``; an ``order`` is given at the start."""

    cycles: int
    kind: str
    size: float
    order: str


EVENTS = st.lists(
    st.builds(
        Event,
        st.integers(1, 60),
        st.sampled_from(KINDS),
        st.floats(-3, 3),
        st.sampled_from(["move", "stop", "nothing"]),
    ),
    min_size=1,
    max_size=8,
)


def shown_position(event: Event, cycle: int, true: float, frozen: float) -> float:
    """Return the position that a sensor shows in a cycle of an event; ``frozen`` is the one before the event."""
    return {
        "none": true,
        "outlier": event.size if cycle in (3, 4) else true,
        "zeros": 0.0 if cycle % 2 else true,
        "seam": true - math.tau if cycle > 5 else true,
        "shift": true + event.size / 10.0,
        "noise": true + event.size * 1e-3 * (-1) ** cycle,
        "freeze": frozen,
        "unknown": math.nan,
    }[event.kind]
