"""Copies of the components of a robot in processes that hear no robot."""

from collections.abc import Mapping
from typing import Any

import msgspec

from linked_fleet_agent.wire.components import read_declarations
from linked_fleet_gateway.extensions.components.part import ComponentPart, parts_from
from linked_fleet_gateway.extensions.components.state import ComponentState, Happened, RobotState
from linked_fleet_gateway.faces import RobotPart, parts_of
from linked_fleet_gateway.fleet.answers import DescriptionAndComponents
from linked_fleet_gateway.fleet.robot import Robot


class _Component(msgspec.Struct):
    """The values of a component, each with its time, its events and its fault."""

    values: dict[str, tuple[Any, int]]
    events: dict[str, Happened]
    fault: str


class _Values(msgspec.Struct):
    """The values of all components by name, in one run of the agent."""

    incarnation: int
    components: dict[str, _Component]


_decoder = msgspec.json.Decoder(_Values)


class ComponentCopier:
    """Implements ``linked_fleet_gateway.faces.PartCopier``."""

    @staticmethod
    def version(robot: Robot) -> object:
        state = _state_of(robot)
        return state and (state, state.incarnation, state.changes)

    @staticmethod
    def write(robot: Robot) -> bytes:
        state = _state_of(robot)
        return b"" if state is None else msgspec.json.encode(_values_of(state))

    @staticmethod
    def make(robot: Robot) -> Mapping[str, RobotPart]:
        said, model = robot.description, robot.model
        if not isinstance(said, DescriptionAndComponents) or model is None:
            return {}
        components, _ = read_declarations(said.components, model.links, model.joints)
        return parts_from(robot, model, components, RobotState(components, said.incarnation))

    @staticmethod
    def read(robot: Robot, values: bytes) -> None:
        state = _state_of(robot)
        if state is None or not values:
            return
        said = _decoder.decode(values)
        if said.incarnation != state.incarnation:
            state.restart(said.incarnation)
        for name, component in said.components.items():
            if (known := state.components.get(name)) is not None:
                known.assume(component.values, component.events, component.fault)


def _state_of(robot: Robot) -> RobotState | None:
    part = next(iter(parts_of(robot).values()), None)
    return part.whole if isinstance(part, ComponentPart) else None


def _values_of(state: RobotState) -> _Values:
    return _Values(state.incarnation, {name: _component_of(each) for name, each in state.components.items()})


def _component_of(state: ComponentState) -> _Component:
    values = {name: (value, state.times_ns[name]) for name, value in state.values.items()}
    return _Component(values, state.events, state.fault)
