"""Detection of positions that stay outside the limits of the URDF. Pure; times are passed in."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from linked_fleet_state.observation import FAULTY_AFTER_NS
from linked_fleet_state.robot import Robot


@dataclass(slots=True)
class LimitWatch:
    """Watches one robot. ``outside_ns`` is the gateway wall time since which every checked frame was outside."""

    judged: bytes | None = None
    outside_ns: int | None = None

    def check(
        self, robot: Robot, now_ns: int, complain: Callable[[str, object], None]
    ) -> Literal["faulty", "recovered"] | None:
        """Check the latest frame and set ``limit_fault`` of the robot. Return the change, if any."""
        robot.adopt_latest_frame()
        payload = robot.payload if robot.online else None
        fresh, self.judged = payload is not self.judged, payload
        if not fresh and self.outside_ns is None:
            return None
        outside = robot.joints_outside_limits() if payload is not None else []
        if not outside:
            self.outside_ns = None
            if robot.limit_fault is None:
                return None
            robot.limit_fault = None
            robot.count_change()
            return "recovered"
        if fresh:
            (name, value), *_ = outside
            complain(robot.name, f"joint {name!r} at {value:g}, outside its limits")
        if self.outside_ns is None:
            self.outside_ns = now_ns
        if robot.limit_fault is not None or now_ns - self.outside_ns < FAULTY_AFTER_NS:
            return None
        robot.limit_fault = f"Joints read positions outside their limits: {', '.join(name for name, _ in outside[:8])}"
        robot.count_change()
        return "faulty"
