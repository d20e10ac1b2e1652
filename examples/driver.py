"""Connect a robot to the fleet by a driver: a camera head that pans and tilts.

Usage: python driver.py [--connect tcp/127.0.0.1:7447] and further flags of linked-fleet-agent

The two servos are simulated. Replace the lines that end with "bus" by those that speak to yours.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

from linked_fleet_agent.robot import Facts, Reading
from linked_fleet_agent.serving import run
from linked_fleet_agent.urdf import joints_of

URDF = """
<robot name="head">
  <link name="stand"/> <link name="neck"/> <link name="camera"/>
  <joint name="pan" type="revolute">
    <parent link="stand"/> <child link="neck"/> <origin xyz="0 0 0.2"/> <axis xyz="0 0 1"/>
    <limit lower="-2.6" upper="2.6" velocity="2" effort="1"/>
  </joint>
  <joint name="tilt" type="revolute">
    <parent link="neck"/> <child link="camera"/> <origin xyz="0 0 0.05"/> <axis xyz="0 1 0"/>
    <limit lower="-0.7" upper="0.7" velocity="2" effort="1"/>
  </joint>
</robot>"""
SERVO_RAD_PER_S = 3.0
STEP_RAD = math.tau / 4096  # of the encoders


class Head:
    """A driver: one thread calls these five methods a hundred times a second (linked_fleet_agent/robot.py)."""

    def __init__(self) -> None:
        self._joints = {joint.name: replace(joint, resolution=STEP_RAD) for joint in joints_of(URDF)}
        self._angles = dict.fromkeys(self._joints, 0.0)
        self._goals = dict(self._angles)
        self._read_at_s = math.inf

    def describe(self) -> Facts:
        return Facts("Camera head", URDF, tuple(self._joints.values()))

    def read(self, now_s: float) -> Reading:
        step = SERVO_RAD_PER_S * max(0.0, now_s - self._read_at_s)  # bus
        for name, goal in self._goals.items():  # bus
            self._angles[name] += max(-step, min(step, goal - self._angles[name]))  # bus
        self._read_at_s = now_s
        angles = [STEP_RAD * round(angle / STEP_RAD) for angle in self._angles.values()]  # bus
        unknown = (math.nan,) * len(angles)  # neither speed nor effort is measured
        return Reading(tuple(angles), unknown, unknown)

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        if wrong := [name for name, goal in setpoints.items() if name not in self._joints or not math.isfinite(goal)]:
            raise ValueError(f"cannot be set: {', '.join(wrong)}")
        applied = {name: self._joints[name].limits.clamp(goal) for name, goal in setpoints.items()}
        self._goals |= applied  # bus
        return applied

    def stop(self) -> None:
        self._goals = dict(self._angles)  # bus

    close = stop


if __name__ == "__main__":
    run("head", Head())
