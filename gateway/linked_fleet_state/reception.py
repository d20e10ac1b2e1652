"""The reception of the frames of a robot, by their sequence numbers and by the time since the last one. Pure."""

from collections import deque
from dataclasses import dataclass, field

from linked_fleet_state.robot import LinkQuality, Robot

SAMPLE_NS = 1_000_000_000
SAMPLES = 10
WEAK_BELOW, GOOD_FROM = 0.95, 0.98
"""Shares of the frames of the last ten seconds that have arrived. In between the quality stays as it was."""
LEAST_FRAMES = 5
"""A share of fewer frames says nothing."""
SILENT_NS = 3_000_000_000
SILENT_PERIODS = 5
"""A robot that sends seldom is lost after so many of its periods."""


@dataclass(slots=True)
class ReceptionWatch:
    """Watches one robot. ``samples``: time, number of frames that have arrived, and sequence number of the last one."""

    run: int | None = None
    samples: deque[tuple[int, int, int]] = field(default_factory=lambda: deque(maxlen=SAMPLES + 1))

    def check(self, robot: Robot, now_ns: int) -> bool:
        """Set the quality of the link of the robot. Return True if it changes."""
        if self.run != robot.incarnation or not robot.online:
            self.run = robot.incarnation
            self.samples.clear()
        quality = self._judge(robot, now_ns) if robot.online else None
        if quality == robot.link_quality:
            return False
        robot.link_quality = quality
        robot.count_change()
        return True

    def _judge(self, robot: Robot, now_ns: int) -> LinkQuality | None:
        arrived = robot.arrived
        if arrived is None:
            return None
        count, sequence, last_ns = arrived
        if self.samples and count < self.samples[-1][1]:  # counted anew, as after another description
            self.samples.clear()
        if not self.samples or now_ns - self.samples[-1][0] >= SAMPLE_NS:
            self.samples.append((now_ns, count, sequence))
        begin_ns, count_before, sequence_before = self.samples[0]
        came, sent = count - count_before, sequence - sequence_before
        period_ns = (now_ns - begin_ns) // came if came else 0
        if now_ns - last_ns > max(SILENT_NS, SILENT_PERIODS * period_ns):
            return "linkLost"
        if sent < LEAST_FRAMES:
            return robot.link_quality if robot.link_quality != "linkLost" else None
        share = came / sent
        if share < WEAK_BELOW:
            return "linkWeak"
        return "linkGood" if share >= GOOD_FROM or robot.link_quality is None else robot.link_quality
