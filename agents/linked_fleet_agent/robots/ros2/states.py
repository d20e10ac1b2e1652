"""Components of known kinds that tell states of a ROS robot: batteries, diagnostics, modes and protective stops."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Annotated, Any

from msgspec import Meta

from linked_fleet_agent.components import kinds
from linked_fleet_agent.components.component import action, value
from linked_fleet_agent.robots.ros2.inbox import Inbox

_STALE_S = 10.0
"""A state that is not repeated within this time is unknown; diagnostics and batteries come once a second or so."""
_POWER: Mapping[int, kinds.PowerSupplyState] = {1: "charging", 2: "discharging", 3: "discharging", 4: "full"}
_LEVELS: tuple[kinds.Level, ...] = ("ok", "warning", "error", "stale")
MAX_STATUS = 256
NORMAL, REDUCED = 1, 2
_SAFETY: Mapping[int, str] = {
    3: "a protective stop is active",
    4: "the robot is in recovery mode",
    5: "a safeguard stop is active",
    6: "the emergency stop of the system is active",
    7: "the emergency stop of the robot is active",
    8: "a safety limit is violated",
    9: "the safety system has a fault",
    10: "the robot waits for its joints to be identified",
    12: "the safeguard stop of the automatic mode is active",
    13: "the enabling switch is not pressed",
}


class RosBattery(kinds.Battery, blocking=False, stale_s=30.0):
    """The battery of the robot, as its sensor_msgs/BatteryState says."""

    def __init__(self, name: str, inbox: Inbox) -> None:
        self.name, self._inbox = name, inbox

    @value
    def charge(self) -> kinds.Charge:
        """Return the charge; unknown if the battery does not measure it."""
        # REP 147 and the message have a share of one; many drivers send percents.
        share = self._said()["percentage"]
        return min(100.0 * share if share <= 1.0 else share, 100.0) if share >= 0.0 else math.nan

    @value
    def power_supply_state(self) -> kinds.PowerSupplyState:
        """Tell whether the battery is charged or used."""
        return _POWER.get(self._said()["power_supply_status"], "unknown")

    @value
    def voltage(self) -> kinds.Voltage:
        """Return the voltage."""
        return float(self._said()["voltage"])

    @value
    def current(self) -> kinds.Current:
        """Return the current, which is negative while the battery is used."""
        return float(self._said()["current"])

    def _said(self) -> dict[str, Any]:
        return said_by(self._inbox, 3.0 * _STALE_S)


class RosDiagnostics(kinds.Diagnostics, blocking=False):
    """The states of the parts of the robot, as its diagnostic_msgs/DiagnosticArray says."""

    def __init__(self, name: str, inbox: Inbox) -> None:
        self.name, self._inbox = name, inbox
        self._status = dict[str, tuple[kinds.Status, float]]()

    @value
    def status(self) -> Annotated[list[kinds.Status], Meta(max_length=MAX_STATUS)]:
        """Return the last status of each part; one that is not repeated is stale."""
        now_s = time.monotonic()
        for said in self._inbox.fetch():
            for each in said["status"]:
                self._note(each, now_s)
        return [each if now_s - at_s <= _STALE_S else _stale(each) for each, at_s in self._status.values()]

    def _note(self, said: Mapping[str, Any], now_s: float) -> None:
        name, number = said["name"][:128], said["level"]
        if name in self._status or len(self._status) < MAX_STATUS:
            known: kinds.Level = _LEVELS[number] if 0 <= number < len(_LEVELS) else "error"
            self._status[name] = kinds.Status(name, known, said["message"][:1024]), now_s


def _stale(said: kinds.Status) -> kinds.Status:
    return kinds.Status(said.name, "stale", said.message)


class RosMode(kinds.Mode):
    """Protective stops and speed scaling of a robot whose controller states them, as those of Universal Robots do.

    The agent moves nothing while a stop is active. The mode is chosen at the robot's own controls.
    """

    name = "mode"

    def __init__(self, safety: Inbox | None, scaling: Inbox | None, unlock: Callable[[], Any] | None) -> None:
        self._safety, self._scaling, self._unlock = safety, scaling, unlock

    def on_tick(self, now_s: float) -> None:
        if self._safety is not None and (said := self._safety.newest()):
            number = said["mode"]
            self.prevents_motion = "" if number in (NORMAL, REDUCED) else _SAFETY.get(number, f"safety mode {number}")

    @value
    def mode(self) -> kinds.OperationalMode:
        """Operate by programs and clients."""
        return "automatic"

    @mode.setter
    def set_mode(self, mode: kinds.OperationalMode) -> None:
        if mode != "automatic":
            raise ValueError("the mode of this robot is chosen at its own controls, not over the network")

    @value
    def speed_scale(self) -> kinds.SpeedScale:
        """Return the share of its speed that the robot uses."""
        if self._scaling is None:
            return 1.0
        return min(max(float(said_by(self._scaling, _STALE_S)["data"]) / 100.0, 0.0), 1.0)

    @action()
    async def reset(self) -> None:
        """End the protective stop. Nothing moves by it, and ended motions do not go on."""
        if self._unlock is None:
            raise ValueError("this robot offers no service that ends a protective stop; end it at its own controls")
        await self._unlock()


def said_by(inbox: Inbox, stale_s: float) -> dict[str, Any]:
    """Return the newest message of a topic. Raises ValueError if there is none, or it is old."""
    said = inbox.newest()
    if not said:
        raise ValueError(f"no message has come on {inbox.topic}")
    if not inbox.is_fresh(time.monotonic(), stale_s):
        raise ValueError(f"no message has come on {inbox.topic} for {stale_s:g} s")
    return said
