"""An agent of a robot with two joints and a component that counts: each reading of it is a new value and an event.

Its joints declare a tolerance.
"""

from dataclasses import replace

from component_agent import ExactRobot
from linked_fleet_agent.components import Component, event, value
from linked_fleet_agent.robot import Facts
from linked_fleet_agent.serving import run


class Counter(Component, rate_hz=50):
    """A counter of its own readings."""

    counted = event()
    readings = 0

    @value
    def count(self) -> int:
        self.readings += 1
        self.counted()
        return self.readings


class Robot(ExactRobot):
    def describe(self) -> Facts:
        said = super().describe()
        return replace(said, joints=tuple(replace(joint, tolerance=0.01) for joint in said.joints))


if __name__ == "__main__":
    run("r", Robot(Counter()))
