"""Give a robot a base that drives: two wheels with a motor each.

Usage: python base.py [--connect tcp/127.0.0.1:7447] and further flags of linked-fleet-agent. The motors are
simulated: replace the lines that end with "bus" by those that speak to yours. Let them stop by themselves when no rate
has come for 0.2 s: this program can end at any time.
"""

from linked_fleet_agent.components.driving import VelocityBase
from linked_fleet_agent.planar import Differential, DriveLimits, Pose, Velocity
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.serving import run

URDF = """<robot name="cart"> <link name="base">
    <visual> <origin xyz="0 0 0.11"/> <geometry> <box size="0.5 0.36 0.14"/> </geometry> </visual>
    <collision> <origin xyz="0 0 0.11"/> <geometry> <box size="0.5 0.36 0.14"/> </geometry> </collision> </link>
  <link name="left_wheel"/> <link name="right_wheel"/>
  <joint name="left" type="continuous"> <parent link="base"/> <child link="left_wheel"/> <axis xyz="0 1 0"/>
    <origin xyz="0 0.2 0.08"/> </joint>
  <joint name="right" type="continuous"> <parent link="base"/> <child link="right_wheel"/> <axis xyz="0 1 0"/>
    <origin xyz="0 -0.2 0.08"/> </joint> </robot>"""
DRIVE = Differential(radius=0.08, separation=0.4)
LIMITS = DriveLimits(linear=0.8, angular=1.5, linear_acceleration=0.8, angular_acceleration=2.0)


class Cart(VelocityBase, limits=LIMITS):
    """Two driven wheels and a caster."""

    corners = ((0.25, -0.22), (0.25, 0.22), (-0.25, 0.22), (-0.25, -0.22))

    def __init__(self) -> None:
        super().__init__()
        self.odometry, self.angles, self.rates = Pose(), (0.0, 0.0), (0.0, 0.0)

    def send(self, velocity: Velocity) -> None:
        self.rates = DRIVE.wheels(velocity)  # bus

    def measure(self, elapsed_s: float) -> tuple[Pose, Velocity]:
        before, rates = self.angles, self.rates  # bus
        left, right = self.angles = before[0] + rates[0] * elapsed_s, before[1] + rates[1] * elapsed_s  # bus
        self.odometry = DRIVE.moved(self.odometry, left - before[0], right - before[1])
        return self.odometry, DRIVE.body(*rates)


if __name__ == "__main__":
    it = Cart()
    run("cart", RobotOfComponents("Cart", it, urdf=URDF, measure=lambda: it.angles, measure_base=lambda: it.reading))
