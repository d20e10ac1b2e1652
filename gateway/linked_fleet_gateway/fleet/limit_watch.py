"""How long the positions of one robot have been outside the limits of its URDF. Pure; times are handed in."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from linked_fleet_gateway.fleet.limits import FAULTY_AFTER_NS
from linked_fleet_gateway.fleet.robot import Robot


@dataclass(slots=True)
class LimitWatch:
    """``outside_ns``: since when, in gateway wall time, each frame that was judged has been outside."""

    judged: bytes | None = None
    outside_ns: int | None = None

    def judge(
        self, robot: Robot, now_ns: int, complain: Callable[[str, object], None]
    ) -> Literal["faulty", "recovered"] | None:
        """Judge the latest frame of the robot, and set its ``limit_fault``. Return the change of it."""
        robot.look()
        payload = robot.payload if robot.online else None
        fresh, self.judged = payload is not self.judged, payload
        if not fresh and self.outside_ns is None:
            return None
        outside = robot.outside() if payload is not None else []
        if not outside:
            self.outside_ns = None
            if robot.limit_fault is None:
                return None
            robot.limit_fault = None
            robot.tell_news()
            return "recovered"
        if fresh:
            (name, value), *_ = outside
            complain(robot.name, f"joint {name!r} at {value:g}, outside its limits")
        if self.outside_ns is None:
            self.outside_ns = now_ns
        if robot.limit_fault is not None or now_ns - self.outside_ns < FAULTY_AFTER_NS:
            return None
        robot.limit_fault = f"Joints read positions outside their limits: {', '.join(name for name, _ in outside[:8])}"
        robot.tell_news()
        return "faulty"
