"""Odometry of a simulated base, which drifts if it is told to. Pure."""

import math

from linked_fleet_agent.planar import Pose


class Odometry:
    """Counts the way of a base. ``drift`` is the share by which it counts too much way and too much turn."""

    def __init__(self, true: Pose) -> None:
        self.drift, self.pose = 0.0, Pose()
        self._counted = true

    def seen(self, true: Pose) -> Pose:
        """Return where something is that the base sees, in the frame that it counts in."""
        here, pose = self._counted, self.pose
        turn = math.remainder(pose.heading - here.heading, math.tau)
        cosine, sine, x, y = math.cos(turn), math.sin(turn), true.x - here.x, true.y - here.y
        return Pose(pose.x + x * cosine - y * sine, pose.y + x * sine + y * cosine, true.heading + turn)

    def count(self, true: Pose) -> None:
        """Count the way to where the base really is now."""
        before, pose, scale = self._counted, self.pose, 1.0 + self.drift
        way_x, way_y = true.x - before.x, true.y - before.y
        cosine, sine = math.cos(pose.heading - before.heading), math.sin(pose.heading - before.heading)
        turn = math.remainder(true.heading - before.heading, math.tau)
        self.pose = Pose(
            pose.x + scale * (way_x * cosine - way_y * sine),
            pose.y + scale * (way_x * sine + way_y * cosine),
            math.remainder(pose.heading + scale * turn, math.tau),
        )
        self._counted = true
