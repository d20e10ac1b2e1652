"""Troubles of robots, read from their present state: presence, agent, sensors, limits, components. Pure.

What is unknown is no trouble, and does not end one: the components of a robot that is offline are not looked at.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from linked_fleet_gateway.api import Robot, joint_path, robot_path
from linked_fleet_gateway.extensions.components.part import ComponentPart
from linked_fleet_gateway.extensions.faults.fault import MOST_SAYS, Severity, Trouble
from linked_fleet_gateway.extensions.faults.kinds import CLOCK_S, EFFORT, EMPTY_PERCENT, LOW_PERCENT, SILENT_S
from linked_fleet_gateway.extensions.faults.terms import LF

_IRI = LF.Fault.value.removesuffix("Fault")
MODE, DIAGNOSTICS, GRIPPER = _IRI + "Mode", _IRI + "Diagnostics", _IRI + "Gripper"
_LEVELS: Mapping[str, Severity] = {"warning": "warning", "error": "error", "stale": "warning"}


def trouble(robot: Robot, kind: str, says: str, severity: Severity = "error", place: str = "", **more: Any) -> Trouble:
    """Return a trouble of a robot, or of a part of it at a path."""
    where = place or robot_path(robot.name)
    return Trouble(kind, where, (robot.name,), severity, says[:MOST_SAYS], **more)


def presence_of(robot: Robot, now_ns: int) -> Iterator[Trouble]:
    """Yield the trouble that the agent of a robot has gone, or says nothing."""
    last_ns = robot.last_seen_ns
    if not robot.online:
        if robot.description is not None:
            yield trouble(robot, "offline", f"The agent of {robot.title} is not there.")
    elif robot.described and last_ns is not None and now_ns - last_ns > SILENT_S * 1e9:
        yield trouble(robot, "silent", f"The agent of {robot.title} is there, and says nothing.")


def of_robot(robot: Robot, strays: bool = False) -> Iterator[Trouble]:
    """Yield the troubles of a robot that is online as a whole, and of its joints. ``strays``: moved by no command."""
    if strays:
        says = f"{robot.title} moves, and no command of this fleet causes it."
        yield trouble(robot, "uncommanded", says, "information")
    if robot.agent_fault:
        yield trouble(robot, "agent", robot.agent_fault)
    if robot.limit_fault:
        yield trouble(robot, "limits", robot.limit_fault)
    for joint, says in robot.sensor_faults.items():
        yield trouble(robot, "sensor", says, place=joint_path(robot.name, joint))
    if (mismatch := _of_description(robot)) is not None:
        yield trouble(robot, "description", mismatch)
    if robot.findings:
        yield trouble(robot, "parts", "Parts are left out: " + " ".join(robot.findings), "warning")


def _of_description(robot: Robot) -> str | None:
    others = (robot.agent_fault, robot.limit_fault, *robot.sensor_faults.values())
    return robot.fault if robot.fault and robot.fault not in others else None


def of_frame(robot: Robot) -> Iterator[Trouble]:
    """Yield the troubles in the latest frame: clocks that differ, and efforts above what is declared."""
    robot.adopt_latest_frame()
    wall_ns, received_ns = robot.wall_ns, robot.received_ns
    if wall_ns is not None and received_ns is not None and abs(received_ns - wall_ns) > CLOCK_S * 1e9:
        way = "behind" if received_ns > wall_ns else "ahead of"
        apart = abs(received_ns - wall_ns) / 1e9
        says = f"The clock of the agent is {apart:.0f} s {way} that of the gateway."
        yield trouble(robot, "clock", says, "warning", values={"seconds": f"{apart:.1f}"})
    yield from _efforts(robot)


def _efforts(robot: Robot) -> Iterator[Trouble]:
    frame, said, model = robot.frame, robot.description, robot.model
    if frame is None or said is None or model is None:
        return
    for name, effort in zip(said.joints, frame.efforts, strict=True):
        joint = model.joints.get(name)
        most = None if joint is None else joint.limits.effort
        if most and math.isfinite(effort) and abs(effort) > most * EFFORT:
            says = f"The joint {name} has an effort of {effort:.3g}, above the {most:g} of its description."
            place = joint_path(robot.name, name)
            yield trouble(robot, "effort", says, "warning", place, values={"effort": f"{effort:.3g}"})


# -- components -------------------------------------------------------------------------------------------------------


def components_of(robot: Robot) -> list[ComponentPart]:
    """Return the components of a robot."""
    return [each for each in robot.parts.values() if isinstance(each, ComponentPart)]


def reader_of(part: ComponentPart) -> Callable[[ComponentPart], object]:
    """Return a function that reads quickly what the troubles of a component depend on, besides its own fault."""
    kind = part.declared.semantic_type
    if kind == MODE:
        return lambda each: (each.state.value("protectiveStop"), each.state.value("reason"))
    if kind == DIAGNOSTICS:
        return lambda each: each.state.value("status")
    return _low if part.is_battery else lambda each: None


def of_component(robot: Robot, part: ComponentPart) -> Iterator[Trouble]:
    """Yield the troubles of a component of a robot that is online."""
    state, kind = part.state, part.declared.semantic_type
    if state.fault:
        yield trouble(robot, "component", state.fault, place=part.path)
    if state.stale:
        yield trouble(robot, "stale", f"{part.title} says nothing any more.", "warning", part.path)
    elif kind == MODE and state.value("protectiveStop"):
        says = state.value("reason") or "A protective stop is active."
        yield trouble(robot, "protective-stop", str(says), "error", part.path)
    elif kind == DIAGNOSTICS:
        yield from _diagnostics(robot, part)
    elif part.is_battery:
        yield from _battery(robot, part)


def _diagnostics(robot: Robot, part: ComponentPart) -> Iterator[Trouble]:
    for item in part.state.value("status") or ():
        severity = _LEVELS.get(item["level"])
        if severity is not None:
            name = str(item["name"])[:100]
            says = f"{name}: {item['message'] or item['level']}"
            yield trouble(robot, f"diagnostics {name}", says, severity, part.path)


def _low(part: ComponentPart) -> Severity | None:
    """Return how bad the charge of a battery is; None if it suffices, is unknown, or grows."""
    charge = part.battery_percent
    if charge is None or charge >= LOW_PERCENT or part.state.value("powerSupplyState") == "charging":
        return None
    return "error" if charge < EMPTY_PERCENT else "warning"


def _battery(robot: Robot, part: ComponentPart) -> Iterator[Trouble]:
    charge, severity = part.battery_percent, _low(part)
    if charge is None or severity is None:
        return
    values = {"charge": f"{charge:.0f} %"}
    yield trouble(robot, "battery", f"{part.title} has {charge:.0f} % left.", severity, part.path, values=values)


def telling_events(components: Iterable[ComponentPart]) -> list[tuple[ComponentPart, str]]:
    """Return the events of components that tell of faults: those of the type ``lf:Fault``, and lost objects."""
    return [
        (each, name)
        for each in components
        for name, declared in each.declared.events.items()
        if declared.semantic_type == LF.Fault.value or (each.declared.semantic_type == GRIPPER and name == "lost")
    ]


def of_event(robot: Robot, part: ComponentPart, name: str, data: object) -> Trouble:
    """Return the trouble that an event tells of."""
    if part.declared.events[name].semantic_type == LF.Fault.value:
        return _told(robot, part, name, data)
    return trouble(robot, "object-lost", f"{part.title} has lost what it held.", "warning", part.path, event=True)


def _told(robot: Robot, part: ComponentPart, name: str, data: object) -> Trouble:
    """Return the fault that an event of the type ``lf:Fault`` tells of."""
    said = data if isinstance(data, Mapping) else {"message": data}
    severity: Severity = next((each for each in _ALL if said.get("severity") == each), "error")
    says = str(said.get("message") or f"{part.title}: {name}")
    return trouble(robot, name, says, severity, part.path, event=True, latched=said.get("latched") is True)


_ALL: tuple[Severity, ...] = ("information", "warning", "error", "critical")
