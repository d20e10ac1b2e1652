"""Setpoints that come a hundred times a second → the one point that a trajectory controller goes to next. Pure.

The joint_trajectory_controller of ros2_control replaces its trajectory by each new one, and where the last one ends it
holds. So it is sent one point at a time, as MoveIt Servo does: where the joints shall be, to be reached a few cycles
later. Between two of them it interpolates, and if no more come it stands where the last one was.
"""

import math
from collections.abc import Iterable, Mapping

# A point is reached this long after it was sent, or after so many cycles of the agent if they are slow.
SOONEST_S, CYCLES, LATEST_S = 0.05, 3, 0.5
# A joint within this of where it was sent counts as holding that; taking its sag as the next point would sag once more.
_HOLDING = 0.01


def reached_in_s(cycle_s: float) -> float:
    """How long after it was sent a point is to be reached, for an agent that sends one in each cycle."""
    return min(max(SOONEST_S, CYCLES * cycle_s), LATEST_S)


class Follower:
    """One controller. It wants all of its joints in each message: those that are not moved stay where they are."""

    def __init__(self, topic: str, joints: Iterable[str]) -> None:
        self.topic, self.joints = topic, tuple(joints)
        self._sent: dict[str, float] = {}
        self._sent_s = -math.inf

    def next(self, setpoints: Mapping[str, float], measured: Mapping[str, float], now_s: float) -> dict[str, float]:
        """The positions to send (rad or m). After a pause a joint that others have moved meanwhile stays there.

        A joint of which nothing is known, neither a setpoint nor a position (NaN), is left out.
        """
        staying = self._held(measured)
        if now_s - self._sent_s <= LATEST_S:
            staying |= self._sent
        return self._note(staying | dict(setpoints), now_s)

    def hold(self, measured: Mapping[str, float], now_s: float) -> dict[str, float]:
        """The positions at which they are to stay: those that are known."""
        return self._note(self._held(measured), now_s)

    def _held(self, measured: Mapping[str, float]) -> dict[str, float]:
        known = {name: measured[name] for name in self.joints if math.isfinite(measured[name])}
        sent = {name: self._sent.get(name, at) for name, at in known.items()}
        return {name: sent[name] if abs(sent[name] - at) <= _HOLDING else at for name, at in known.items()}

    def _note(self, positions: dict[str, float], now_s: float) -> dict[str, float]:
        self._sent, self._sent_s = positions, now_s
        return {name: positions[name] for name in self.joints if name in positions}
