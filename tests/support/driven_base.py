"""A base that has at once each velocity that is sent, under its agent."""

import itertools

from component_agent import Bench
from linked_fleet_agent.components.driving import VelocityBase
from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Velocity
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.wire.messages import Accepted

LIMITS = DriveLimits(linear=1.0, angular=2.0, linear_acceleration=2.0, angular_acceleration=4.0, lateral=0.5)


class Ideal(VelocityBase, limits=LIMITS):
    """A base that has at once each velocity that is sent."""

    corners = ((0.3, -0.2), (0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2))

    def __init__(self) -> None:
        super().__init__()
        self.sent = [STANDING]
        self.at, self.broken = Pose(), ""

    def send(self, velocity: Velocity) -> None:
        if self.broken:
            raise OSError(self.broken)
        self.sent.append(velocity)

    def measure(self, elapsed_s: float) -> tuple[Pose, Velocity]:
        linear, lateral, angular = self.sent[-1]
        self.at = self.at.moved(linear * elapsed_s, angular * elapsed_s, lateral * elapsed_s)
        return self.at, self.sent[-1]


class Driven(Bench):
    def __init__(self, base: Ideal | None = None) -> None:
        self.base = base or Ideal()
        super().__init__(other=RobotOfComponents("Base", self.base, measure_base=lambda: self.base.reading))

    def drive(self, id: str, **given: float) -> None:
        assert isinstance(self.operate(id, "drive", given, component="mobile_base"), Accepted)

    async def driving(self) -> None:
        """Begin to drive for a second, and reach half a metre per second."""
        self.drive("d", linear=0.5, duration=1.0)
        await self.tick(0.4)
        assert self.base.sent[-1] == Velocity(0.5)

    def interrupt(self, way: str) -> None:
        """End what moves the base: by a stop, the loss of the last gateway, or a protective stop."""
        if way == "stop":
            assert isinstance(self.stop("s"), Accepted)
        elif way == "gateway":
            self.link.gateway_present = False
        else:
            assert way == "protective stop"
            self.base.prevents_motion = "the gate is open"

    @property
    def decelerations(self) -> list[float]:
        speeds = [each.linear for each in self.base.sent]
        return [(before - after) / 0.01 for before, after in itertools.pairwise(speeds)]
