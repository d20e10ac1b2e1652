"""A door on a hobby servo: PWM out, a potentiometer at an analogue input (IIO) in, as files of Linux.

Usage: python door.py [--connect tcp/192.0.2.10:7447] and further flags of linked-fleet-agent
"""

import math
import os
from collections.abc import Mapping
from pathlib import Path

from linked_fleet_agent.robot import Facts, Reading, RobotFaultError
from linked_fleet_agent.serving import run
from linked_fleet_agent.urdf import joints_of

URDF = """
<robot name="door"> <link name="frame"/> <link name="leaf"/>
  <joint name="hinge" type="revolute">
    <parent link="frame"/> <child link="leaf"/> <axis xyz="0 0 1"/>
    <limit lower="0" upper="1.5708" velocity="1" effort="2"/>
  </joint>
</robot>"""
PWM = Path(os.environ.get("DOOR_PWM", "/sys/class/pwm/pwmchip0/pwm0"))
ANGLE = Path(os.environ.get("DOOR_ANGLE", "/sys/bus/iio/devices/iio:device0/in_voltage0_raw"))
PERIOD_NS, CLOSED_NS, NS_PER_RAD, RAD_PER_STEP = 20_000_000, 1_000_000, 1_000_000 / 1.5708, 1.5708 / 4095


class Door:
    def __init__(self, pwm: Path, angle: Path) -> None:
        self._pwm, self._angle = pwm, angle
        (self._hinge,) = joints_of(URDF)

    def describe(self) -> Facts:
        return Facts("Door of the laboratory", URDF, (self._hinge,))

    def read(self, now_s: float) -> Reading:
        try:
            position = int(self._angle.read_text()) * RAD_PER_STEP
        except (OSError, ValueError) as error:
            raise RobotFaultError(f"the potentiometer cannot be read: {error}") from error
        return Reading((position,), (math.nan,), (math.nan,))

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        if wrong := [name for name, goal in setpoints.items() if name != "hinge" or not math.isfinite(goal)]:
            raise ValueError(f"cannot be set: {', '.join(wrong)}")
        applied = {name: self._hinge.limits.clamp(goal) for name, goal in setpoints.items()}
        for goal in applied.values():
            self._write(period=PERIOD_NS, duty_cycle=round(CLOSED_NS + goal * NS_PER_RAD), enable=1)
        return applied

    def stop(self) -> None:
        self.apply({"hinge": self.read(0.0).positions[0]})

    def close(self) -> None:
        self._write(enable=0)

    def _write(self, **values: int) -> None:
        try:
            for file, value in values.items():
                (self._pwm / file).write_text(str(value))
        except OSError as error:
            raise RobotFaultError(f"the servo cannot be driven: {error}") from error


if __name__ == "__main__":
    run("door", Door(PWM, ANGLE))
