"""Give a robot a gripper: values, an action with feedback and a result, an event.

Usage: python gripper.py [--connect tcp/127.0.0.1:7447] and further flags of linked-fleet-agent

The motor is simulated. Replace the lines that end with "bus" by those that speak to yours.
"""

from typing import Annotated

from msgspec import Meta, Struct

from linked_fleet_agent.components import Call, Component, action, event, unit, value
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.serving import run

URDF = """
<robot name="gripper"> <link name="hand"/> <link name="finger"/>
  <joint name="slide" type="prismatic">
    <parent link="hand"/> <child link="finger"/> <limit lower="0" upper="0.08" velocity="0.1" effort="70"/>
  </joint>
</robot>"""
Width = Annotated[float, unit("M"), Meta(ge=0, le=0.08, title="Distance of the fingers")]
Force = Annotated[float, unit("N"), Meta(gt=0, le=70, title="Force of the fingers")]


class Grasped(Struct):
    width: Width
    holding: Annotated[bool, Meta(title="Whether something is held")]


class Gripper(Component, rate_hz=20):
    """A gripper with two fingers."""

    lost = event(title="Object lost")
    gap, thing = 0.08, 0.03  # bus

    @value
    def width(self) -> Width:
        return self.gap  # bus

    @action(moves=["slide"], duration_s=10, stop_s=0.2)
    def grasp(self, call: Call[Width], width: Width = 0.0, force: Force = 20.0) -> Grasped:
        """Close the fingers until something is held. A stop ends it, and the fingers stay where they are."""
        while self.gap > max(width, self.thing):  # bus
            call.sleep(0.02)  # ends here when it is cancelled
            self.gap = max(width, self.thing, self.gap - 0.001)  # bus
            call.feedback(self.gap)
        return Grasped(self.gap, holding=self.gap > width)


if __name__ == "__main__":
    gripper = Gripper()
    run("gripper", RobotOfComponents("Gripper", gripper, urdf=URDF, measure=lambda: [gripper.gap]))
