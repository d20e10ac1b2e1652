"""A robot with components whose values a test sets, without network."""

import itertools
import json
from collections.abc import Iterator
from typing import Any

from msgspec import Raw

from gateway_fixtures import Bench
from linked_fleet_agent.wire.components import Component, Event, Measured, Occurrence, Property, Values
from linked_fleet_agent.wire.kinds import KINDS
from linked_fleet_agent.wire.schema import Schema
from linked_fleet_gateway.extensions.components.part import ComponentPart
from linked_fleet_gateway.extensions.components.state import RobotState
from linked_fleet_state.robot import Robot

LF = "https://w3id.org/linked-fleet#"
JAMMED = Component(
    name="feeder", semantic_type="", properties={"level": Property(schema=Schema(type="number"))},
    events={"jammed": Event(semantic_type=LF + "Fault", data=Schema(type="string")), "filled": Event()},
)  # fmt: skip


class Flapping:
    """The robot ``r`` with a mode, diagnostics, a battery, a gripper, and a feeder that tells of faults."""

    def __init__(self, bench: Bench) -> None:
        self.robot: Robot = bench.robot({"pan": ("revolute", '<limit lower="-1" upper="1" effort="2" velocity="1"/>')})
        assert self.robot.incarnation is not None and self.robot.model is not None
        kinds = [KINDS[LF + name].least for name in ("Mode", "Diagnostics", "Battery", "Gripper")]
        self.state = RobotState([*kinds, JAMMED], self.robot.incarnation)
        parts = [ComponentPart(self.robot, self.robot.model, self.state, each) for each in self.state.components]
        self.robot.set_parts({each.segment: each for each in parts}, ())
        self._numbers: Iterator[int] = itertools.count(1)

    def say(self, component: str, fault: str = "", **values: Any) -> None:
        """Let the robot tell of values of a component."""
        measured = Measured(at_ns=1, values={name: raw(each) for name, each in values.items()}, fault=fault)
        said = Values(components={component: measured}, **self._stamps())
        assert self.state.hear(said)[1] == []

    def happen(self, component: str, event: str, data: Any = None) -> None:
        """Let the robot tell of an event."""
        more = {} if data is None else {"data": raw(data)}
        assert self.state.happen(Occurrence(component=component, event=event, **self._stamps(), **more)) is not None

    def _stamps(self) -> dict[str, Any]:
        number = next(self._numbers)
        run = self.robot.incarnation
        return {"version": 2, "incarnation": run, "sequence": number, "monotonic_ns": number, "wall_ns": number}


def raw(value: Any) -> Raw:
    return Raw(json.dumps(value).encode())
