"""Turns setpoints at the agent's rate into single points for a trajectory controller. Pure.

The joint_trajectory_controller of ros2_control replaces its trajectory by each new one and holds the end of the last.
So it gets one point at a time, as from MoveIt Servo: the positions to reach a few cycles later. It interpolates between
points, and stands at the last one if no more arrive.
"""

import math
from collections.abc import Iterable, Mapping

# A point is reached this long after it was sent, or after this many cycles if the agent's cycles are slow.
SOONEST_S, CYCLES, LATEST_S = 0.05, 3, 0.5
# A joint this close to its last sent position counts as holding it. Sending its sagged position would add sag.
_HOLDING = 0.01


def time_from_start_s(cycle_s: float) -> float:
    """Return the time from sending a point until it is reached, for an agent that sends one per cycle."""
    return min(max(SOONEST_S, CYCLES * cycle_s), LATEST_S)


class TrajectoryPoints:
    """The points of one controller.

    Each message needs all of its joints; those that are not moved stay where they are.
    """

    def __init__(self, topic: str, joints: Iterable[str]) -> None:
        self.topic, self.joints = topic, tuple(joints)
        self._sent: dict[str, float] = {}
        self._sent_s = -math.inf

    def next(self, setpoints: Mapping[str, float], measured: Mapping[str, float], now_s: float) -> dict[str, float]:
        """Return the positions to send (rad or m). After a pause, a joint that others have moved stays at its new
        position.

        Joints with neither a setpoint nor a known position (NaN) are left out.
        """
        staying = self._held(measured)
        if now_s - self._sent_s <= LATEST_S:
            staying |= self._sent
        return self._note(staying | dict(setpoints), now_s)

    def hold(self, measured: Mapping[str, float], now_s: float) -> dict[str, float]:
        """Return the positions that hold the joints; joints with unknown position are left out."""
        return self._note(self._held(measured), now_s)

    def _held(self, measured: Mapping[str, float]) -> dict[str, float]:
        known = {name: measured[name] for name in self.joints if math.isfinite(measured[name])}
        sent = {name: self._sent.get(name, at) for name, at in known.items()}
        return {name: sent[name] if abs(sent[name] - at) <= _HOLDING else at for name, at in known.items()}

    def _note(self, positions: dict[str, float], now_s: float) -> dict[str, float]:
        self._sent, self._sent_s = positions, now_s
        return {name: positions[name] for name in self.joints if name in positions}
