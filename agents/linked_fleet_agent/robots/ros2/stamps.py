"""Time stamps of a topic that are no times: constant, zero, back in time, or of another clock. Pure.

The driver uses the time of arrival anyway. It says once what is wrong with the stamps.
"""

import math

JUMP_S, AHEAD_S = 1.0, 60.0
"""A stamp that has moved on by so much more, or less, than time has jumped; one this far from the wall clock is of
another clock."""
_ALIKE = 10


class Stamps:
    """The stamps of one topic from one publisher. ``finding`` is a sentence about them, empty while they are times."""

    def __init__(self) -> None:
        self.finding = ""
        self._last_ns, self._at_s, self._alike = -1, math.nan, 0

    def update(self, stamp_ns: int, arrived_s: float, wall_ns: int) -> None:
        """Take the stamp of a message that arrived at ``arrived_s`` of the monotonic clock."""
        if not self.finding:
            self.finding = self._judge(stamp_ns, arrived_s, wall_ns)
        self._last_ns, self._at_s = stamp_ns, arrived_s

    def _judge(self, stamp_ns: int, arrived_s: float, wall_ns: int) -> str:
        if stamp_ns == 0:
            return "have no time stamps"
        if self._last_ns < 0:
            return ""
        step_s, elapsed_s = (stamp_ns - self._last_ns) / 1e9, arrived_s - self._at_s
        self._alike = self._alike + 1 if step_s == 0.0 else 0
        if self._alike >= _ALIKE:
            return "have all the same time stamp"
        if step_s < 0.0:
            return f"have a time stamp that is {-step_s:.3g} s before the one before it"
        if abs(step_s - elapsed_s) > JUMP_S:
            return f"have time stamps that are {step_s:.3g} s apart, but came {elapsed_s:.3g} s after each other"
        if abs(stamp_ns - wall_ns) / 1e9 > AHEAD_S:
            return "have time stamps of another clock, such as that of a simulation"
        return ""
