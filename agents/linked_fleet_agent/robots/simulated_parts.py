"""Components of simulated robots: operational mode, diagnostics, battery and tool, and the simulation itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from linked_fleet_agent.components import (
    Battery,
    Charge,
    Component,
    Diagnostics,
    Mode,
    PowerSupplyState,
    SpeedScale,
    Status,
    Switch,
    Width,
    action,
    unit,
    value,
)
from linked_fleet_agent.components.kinds import PlanarPose
from linked_fleet_agent.robots.parts import BatteryPart, Parts, ToolPart
from linked_fleet_agent.robots.simulated_base import RollingBase, SimulatedBase, base_of
from linked_fleet_agent.robots.simulated_fingers import Fingers, gripper_of

MANUAL_SCALE, LEAST_SCALE = 0.25, 0.1
_LOSSES = 2.0
"""Energy that the motors take for each joule of mechanical work."""
_Drift = Annotated[float, Meta(ge=-0.5, le=0.5, title="Drift of the odometry")]
_SECONDS_PER_HOUR, _SAMPLE_S = 3600.0, 0.05


class SimulatedMode(Mode):
    """Operational mode and protective stop. In manual mode the robot uses a quarter of its speed at most."""

    name, scale = "mode", 1.0

    @property
    def used_scale(self) -> float:
        return min(self.scale, MANUAL_SCALE) if self.operational_mode == "manual" else self.scale

    @value
    def speed_scale(self) -> Annotated[SpeedScale, Meta(ge=LEAST_SCALE)]:
        """Reduce the speed of motions to this share."""
        return self.used_scale

    @speed_scale.setter
    def set_speed_scale(self, scale: float) -> None:
        self.scale = scale


class SimulatedDiagnostics(Diagnostics, blocking=False):
    """The states of the simulation's clock and of its motors."""

    name = "diagnostics"

    def __init__(self, parts: Callable[[], list[Status]]) -> None:
        self._parts = parts

    @value
    def status(self) -> list[Status]:
        return self._parts()


class SimulatedBattery(Battery, blocking=False):
    """A battery that the electronics and the motors drain, and that a plugged charger or a station charges.

    The simulated robot goes on when it is empty.
    """

    name = "battery"

    def __init__(self, part: BatteryPart, mechanical_w: Callable[[], float], docked: Callable[[], bool]) -> None:
        self.link, self._part, self._mechanical_w, self._docked = part.link, part, mechanical_w, docked
        self._full_j = part.capacity_wh * _SECONDS_PER_HOUR
        self.energy_j, self.charger = self._full_j, False
        self._since_s = 0.0

    @property
    def powered(self) -> bool:
        """True while its charger is plugged in, or a station charges it."""
        return self.charger or self._docked()

    def step(self, elapsed_s: float) -> None:
        """Take note that the simulation has advanced."""
        self._since_s += elapsed_s
        if self._since_s >= _SAMPLE_S:
            self._count(self._since_s)
            self._since_s = 0.0

    def _count(self, elapsed_s: float) -> None:
        gained_w = self._part.charger_w if self.powered else 0.0
        change_j = (gained_w - self._part.idle_w - _LOSSES * self._mechanical_w()) * elapsed_s
        self.energy_j = min(max(self.energy_j + change_j, 0.0), self._full_j)

    @value
    def charge(self) -> Charge:
        return round(100.0 * self.energy_j / self._full_j, 1)

    @value
    def power_supply_state(self) -> PowerSupplyState:
        if not self.powered:
            return "discharging"
        return "full" if self.energy_j == self._full_j else "charging"


class Tool(Switch, blocking=False):
    """The digital signals at the tool."""

    name, input_on, output_on = "tool", False, False

    def __init__(self, part: ToolPart) -> None:
        self.title, self.link = part.title, part.link

    @value
    def output(self) -> bool:
        return self.output_on

    @output.setter
    def switch(self, on: bool) -> None:
        self.output_on = on

    @value
    def input(self) -> bool:
        return self.input_on


class Simulation(Component, rename="camel", blocking=False, rate_hz=1):
    """The simulation of this robot, not a part of it: its clock, and what people and things around a robot do to it."""

    name = "simulation"

    def __init__(self, time_s: Callable[[], float], mode: Mode) -> None:
        self._time_s, self._mode = time_s, mode

    @value
    def time(self) -> Annotated[float, unit("SEC"), Meta(title="Simulated time")]:
        return round(self._time_s(), 1)

    @action()
    async def stop_protectively(
        self, reason: Annotated[str, Meta(min_length=1, max_length=512)] = "the safety gate is open"
    ) -> None:
        """Cause a protective stop, as a safety gate does. The component mode resets it."""
        self._mode.stop_protectively(reason)


class SimulationWithFingers(Simulation):
    """A simulation with what is done to its fingers."""

    fingers: Mapping[str, Fingers]

    def _of(self, gripper: str) -> Fingers:
        found = self.fingers.get(gripper or next(iter(self.fingers)))
        if found is None:
            raise ValueError(f"this robot has no gripper {gripper!r}; it has {', '.join(self.fingers)}")
        return found

    @action()
    async def put_object(self, width: Width, gripper: Annotated[str, Meta(max_length=128)] = "") -> None:
        """Put something of a width between the open fingers of a gripper, the first one by default."""
        self._of(gripper).put(width)

    @action()
    async def take_object(self, gripper: Annotated[str, Meta(max_length=128)] = "") -> None:
        """Take away what is between the fingers of a gripper, the first one by default."""
        self._of(gripper).take()


class SimulationWithCharger(Simulation):
    """A simulation with what is done to its battery."""

    battery: SimulatedBattery

    @value
    def charger(self) -> Annotated[bool, Meta(title="Charger plugged in")]:
        return self.battery.charger

    @charger.setter
    def plug(self, charger: bool) -> None:
        self.battery.charger = charger


class SimulationWithTool(Simulation):
    """A simulation with what is done to its tool."""

    tool: Tool

    @value
    def tool_input(self) -> Annotated[bool, Meta(title="Level of the tool input")]:
        return self.tool.input_on

    @tool_input.setter
    def set_tool_input(self, on: bool) -> None:
        self.tool.input_on = on


class SimulationWithBase(Simulation):
    """A simulation with what a base does not know: where it really is."""

    base: SimulatedBase

    @value
    def true_pose(self) -> Annotated[PlanarPose, Meta(title="True pose")]:
        """Return where the base really is, in the frame where its odometry began."""
        x, y, heading = self.base.pose
        return PlanarPose(round(x, 4), round(y, 4), round(heading, 4))

    @value
    def odometry_drift(self) -> _Drift:
        """Let the odometry count this share too much of each way and of each turn."""
        return self.base.odometer.drift

    @odometry_drift.setter
    def set_odometry_drift(self, drift: _Drift) -> None:
        self.base.odometer.drift = drift


@dataclass(frozen=True)
class Measured:
    """Measurements of a simulation for its components: time, mechanical power of all motors, states of its parts."""

    time_s: Callable[[], float]
    mechanical_w: Callable[[], float]
    status: Callable[[], list[Status]]


def components_of(
    parts: Parts, fingers: Mapping[str, Fingers], base: SimulatedBase | None, mode: SimulatedMode, measured: Measured
) -> tuple[list[Component], list[Callable[[float], None]]]:
    """Return the components of a robot, and what must be called after each advance of the simulation, with its time."""

    def docked() -> bool:
        return isinstance(base, RollingBase) and bool(base.contact())

    battery = None if parts.battery is None else SimulatedBattery(parts.battery, measured.mechanical_w, docked)
    tool = None if parts.tool is None else Tool(parts.tool)
    simulation = _simulation(
        measured.time_s, mode, {"fingers": fingers, "base": base, "battery": battery, "tool": tool}
    )
    components: list[Component] = [mode, SimulatedDiagnostics(measured.status)]
    components += [gripper_of(part, fingers[part.name]) for part in parts.fingers]
    if (part := parts.base or parts.legs) is not None and base is not None:
        components.append(base_of(part, base, lambda: mode.used_scale))
    components += [each for each in (battery, tool, simulation) if each is not None]
    return components, [each.step for each in (*fingers.values(), base, battery) if each is not None]


def _simulation(time_s: Callable[[], float], mode: Mode, parts: Mapping[str, object]) -> Simulation:
    """Return the component of a simulation, with what it can do to the parts that the robot has."""
    about = {
        "fingers": SimulationWithFingers,
        "base": SimulationWithBase,
        "battery": SimulationWithCharger,
        "tool": SimulationWithTool,
    }
    bases = tuple(about[name] for name, part in parts.items() if part) or (Simulation,)
    simulation: Simulation = type("Simulation", bases, {"__doc__": Simulation.__doc__, **parts})(time_s, mode)
    return simulation
