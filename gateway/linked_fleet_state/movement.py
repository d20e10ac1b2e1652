"""Detection of movement in measured positions, whoever causes it. Pure; times are passed in."""

import math
from dataclasses import dataclass

from linked_fleet_agent.wire.messages import State
from linked_fleet_state.observation import differ
from linked_fleet_state.robot import Robot

MOVED = 0.002
"""The least change that is a movement (rad or m): more than the noise of usual encoders."""
STILL_AFTER_NS = 1_500_000_000
"""A swaying robot rests for a moment where it turns."""


@dataclass(slots=True)
class MovementWatch:
    """Watches one robot. ``reference``: the values from which the next movement is told."""

    run: int | None = None
    judged: bytes | None = None
    reference: tuple[float, ...] | None = None

    def check(self, robot: Robot, now_ns: int) -> bool:
        """Check the latest frame and set ``moving`` and ``moved_ns`` of the robot. Return True if moving changes."""
        robot.adopt_latest_frame()
        if robot.incarnation != self.run:
            self.run, self.reference = robot.incarnation, None
        frame, fresh = robot.frame, robot.payload is not self.judged
        self.judged = robot.payload
        if robot.online and fresh and frame is not None and self._has_moved(_places(frame)):
            robot.moved_ns = now_ns
        moving = robot.online and robot.moved_ns is not None and now_ns - robot.moved_ns < STILL_AFTER_NS
        if moving == robot.moving:
            return False
        robot.moving = moving
        robot.count_change()
        return True

    def _has_moved(self, places: tuple[float, ...]) -> bool:
        before = self.reference
        if before is not None and len(before) == len(places) and not differ(before, places, MOVED):
            return False
        self.reference = places
        # A value that becomes known or unknown is no movement.
        return (
            before is not None
            and len(before) == len(places)
            and any(
                abs(new - old) >= MOVED for old, new in zip(before, places, strict=True) if math.isfinite(new - old)
            )
        )


def _places(frame: State) -> tuple[float, ...]:
    """Return the positions of the joints, and of a floating base."""
    return frame.positions if frame.base is None else (*frame.positions, *frame.base.position_m)
