"""Four digital inputs and four outputs at the GPIO lines of Linux, as files below /sys/class/gpio.

Usage: python switch_box.py [--connect tcp/192.0.2.10:7447] and further flags of linked-fleet-agent
"""

import os
from pathlib import Path

from linked_fleet_agent.components import Switch, event, value
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.serving import run

GPIO = Path(os.environ.get("SWITCH_BOX_GPIO", "/sys/class/gpio"))
INPUTS, OUTPUTS = (17, 27, 22, 23), (5, 6, 13, 19)


class Input(Switch, rate_hz=50, stale_s=1):
    """A digital input."""

    switched_on = event(title="Switched on")

    def __init__(self, name: str, line: int) -> None:
        self.name, self._file, self._was_on = name, GPIO / f"gpio{line}" / "value", True

    @value
    def input(self) -> bool:
        """Level of the input: true is high."""
        on, before = self._file.read_text().strip() == "1", self._was_on
        self._was_on = on
        if on and not before:
            self.switched_on()
        return on


class Output(Switch, stale_s=1):
    """A digital output."""

    def __init__(self, name: str, line: int) -> None:
        self.name, self._file = name, GPIO / f"gpio{line}" / "value"

    @value
    def output(self) -> bool:
        """Level of the output: true is high."""
        return self._file.read_text().strip() == "1"

    @output.setter
    def switch(self, on: bool) -> None:
        self._file.write_text("1" if on else "0")


def switch_box() -> RobotOfComponents:
    inputs = [Input(f"input{number}", line) for number, line in enumerate(INPUTS, 1)]
    outputs = [Output(f"output{number}", line) for number, line in enumerate(OUTPUTS, 1)]
    return RobotOfComponents("Switch box", *inputs, *outputs)


if __name__ == "__main__":
    run("box", switch_box())
