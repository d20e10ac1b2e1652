"""Give a robot a gripper: values, actions with feedback and a result, an event.

Usage: python gripper.py [--connect tcp/127.0.0.1:7447] and further flags of linked-fleet-agent. The motor is
simulated: replace the lines that end with "bus" by those that speak to yours.
"""

from typing import Annotated

from msgspec import Meta

from linked_fleet_agent.components import Call, Force, Grasped, Gripper, Holding, Width, action, value
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.serving import run

URDF = """<robot name="gripper"> <link name="hand"/> <link name="finger"/> <joint name="slide" type="prismatic">
  <parent link="hand"/> <child link="finger"/> <limit lower="0" upper="0.08" velocity="0.1" effort="70"/>
</joint> </robot>"""
Gap = Annotated[Width, Meta(le=0.08)]


class TwoFingers(Gripper, rate_hz=20):
    """A gripper with two fingers."""

    name, gap, thing, push = "gripper", 0.08, 0.03, 0.0  # bus

    @value
    def width(self) -> Gap:
        return self.gap  # bus

    @value
    def force(self) -> Force:
        return self.push  # bus

    @value
    def holding(self) -> Holding:
        return self.push > 0.0  # bus

    @action(moves=["slide"], duration_s=10, stop_s=0.2)
    def grasp(self, call: Call[Gap], width: Gap = 0.0, force: Annotated[Force, Meta(le=70)] = 20.0) -> Grasped:
        """Close the fingers until something is held. A stop ends it, and the fingers stay where they are."""
        self.move(call, max(width, self.thing))  # bus
        self.push = force if self.gap > width else 0.0  # bus
        return Grasped(self.gap, self.holding, self.push)

    @action(moves=["slide"], duration_s=10, stop_s=0.2)
    def open(self, call: Call[Gap], width: Gap = 0.08) -> None:
        """Open the fingers, and so put down what is held."""
        self.move(call, width)

    def move(self, call: Call[Gap], to: float) -> None:
        self.push = 0.0  # bus
        while abs(to - self.gap) > 1e-9:  # bus
            call.sleep(0.02)  # ends here when it is cancelled
            self.gap += min(max(to - self.gap, -0.001), 0.001)  # bus
            call.feedback(self.gap)


if __name__ == "__main__":
    gripper = TwoFingers()
    run("gripper", RobotOfComponents("Gripper", gripper, urdf=URDF, measure=lambda: [gripper.gap]))
