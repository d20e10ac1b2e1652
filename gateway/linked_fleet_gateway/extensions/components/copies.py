"""The values of the components of a robot as bytes, for processes that hear no robot."""

from typing import Any

import msgspec

from linked_fleet_gateway.extensions.components.state import ComponentState, Happened, RobotState


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


def write_state(state: RobotState) -> bytes:
    return msgspec.json.encode(_values_of(state))


def read_state(state: RobotState, values: bytes) -> None:
    """Give a copy the values that ``write_state`` has returned."""
    said = _decoder.decode(values)
    if said.incarnation != state.incarnation:
        state.restart(said.incarnation)
    for name, component in said.components.items():
        if (known := state.components.get(name)) is not None:
            known.assume(component.values, component.events, component.fault)


def _values_of(state: RobotState) -> _Values:
    return _Values(state.incarnation, {name: _component_of(each) for name, each in state.components.items()})


def _component_of(state: ComponentState) -> _Component:
    values = {name: (value, state.times_ns[name]) for name, value in state.values.items()}
    return _Component(values, state.events, state.fault)
