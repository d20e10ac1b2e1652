"""Base classes of known kinds: a subclass gets kind, terms and names right, and its agent does what the kind says."""

from typing import Annotated, Any

import msgspec
import pytest
from msgspec import Meta, Raw

from component_agent import Bench
from linked_fleet_agent.components import (
    Battery,
    Charge,
    Component,
    DeclarationError,
    Diagnostics,
    Force,
    Grasped,
    Gripper,
    Holding,
    Mode,
    PowerSupplyState,
    SpeedScale,
    Status,
    Switch,
    Voltage,
    Width,
    action,
    event,
    value,
)
from linked_fleet_agent.components.declaration import declare
from linked_fleet_agent.components.schemas import schema_of
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import Values
from linked_fleet_agent.wire.kinds import KINDS, LF
from linked_fleet_agent.wire.messages import Refused


class Fingers(Gripper, blocking=False):
    """A gripper."""

    @value
    def width(self) -> Annotated[Width, Meta(le=0.08)]:
        return 0.02

    @value
    def force(self) -> Force:
        return float("nan")

    @value
    def holding(self) -> Holding:
        return True

    @action(moves=["finger"])
    async def grasp(self, width: Width = 0.0, force: Force = 20.0) -> Grasped:
        self.lost()
        return Grasped(width, holding=True)

    @action(moves=["finger"])
    async def open(self, width: Width = 0.08) -> None: ...


class Cell(Battery, blocking=False):
    """A battery."""

    @value
    def charge(self) -> Charge:
        return 55.0

    @value
    def power_supply_state(self) -> PowerSupplyState:
        return "charging"

    @value
    def voltage(self) -> Voltage:
        return 24.5


class Output(Switch):
    """An output."""

    on = False

    @value
    def output(self) -> bool:
        return self.on

    @output.setter
    def switch(self, on: bool) -> None:
        self.on = on


class Health(Diagnostics, blocking=False):
    """The state of the parts."""

    @value
    def status(self) -> list[Status]:
        return [Status("motor 1", "warning", "hot")]


@pytest.mark.parametrize("made", [Fingers(), Cell(), Output(), Mode(), Health()])
def test_a_subclass_conforms_to_its_kind(made: Component) -> None:
    said = declare(made).said
    least = KINDS[said.semantic_type].least
    common = said.properties.keys() & least.properties.keys()
    assert common
    assert {name: said.properties[name].schema.semantic_type for name in common} == {
        name: least.properties[name].schema.semantic_type for name in common
    }
    assert {name: each.semantic_type for name, each in said.actions.items()} == {
        name: each.semantic_type for name, each in least.actions.items()
    }


def test_a_subclass_that_lacks_a_member_cannot_be_declared() -> None:
    class Half(Battery):
        @value
        def charge(self) -> Charge:
            return 1.0

    with pytest.raises(DeclarationError, match="half: a Battery has a property 'powerSupplyState'; this one has none"):
        declare(Half())


def test_names_of_python_become_those_of_the_kind_and_only_there() -> None:
    class Renamed(Component, rename="camel"):
        one_two = event()

        @value
        def x_y_z(self) -> bool:
            return True

        @action()
        def open_(self) -> None: ...

    said = declare(Renamed()).said
    assert (list(said.properties), list(said.actions), list(said.events)) == (["xYZ"], ["open"], ["oneTwo"])

    class Plain(Component):
        one_two = event()

    assert list(declare(Plain()).said.events) == ["one_two"]


def test_a_range_of_a_kind_is_narrowed_at_both_ends() -> None:
    plain, narrow = schema_of(SpeedScale), schema_of(Annotated[SpeedScale, Meta(ge=0.1, le=0.5)])
    assert (plain.minimum, plain.maximum, narrow.minimum, narrow.maximum) == (0, 1, 0.1, 0.5)
    assert schema_of(Annotated[Force, Meta(gt=0)]).exclusive_minimum == 0


async def test_values_results_and_events_are_those_of_the_kind() -> None:
    bench = Bench(Fingers(), Cell(), Health())
    values = codec.decode(bench.agent.values(), Values).components
    assert values["fingers"].values == {"width": Raw(b"0.02"), "force": Raw(b"null"), "holding": Raw(b"true")}
    assert values["cell"].values["powerSupplyState"] == Raw(b'"charging"')
    assert values["health"].values["status"] == Raw(b'[{"name":"motor 1","level":"warning","message":"hot"}]')
    bench.operate("g", "grasp", {"width": 0.01}, component="fingers")
    await bench.tick(0.02)
    assert bench.end("g").result == Raw(b'{"width":0.01,"holding":true}')
    assert [(each.component, each.event) for each in bench.link.events] == [("fingers", "lost")]


async def test_an_event_with_a_name_of_python_is_sent_with_that_of_the_fleet() -> None:
    class Door(Component, blocking=False, rename="camel"):
        was_opened = event()

    door = Door()
    bench = Bench(door)
    door.was_opened()
    await bench.tick()
    assert [each.event for each in bench.link.events] == ["wasOpened"]


def last(bench: Bench, component: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for message in bench.link.values:
        if component in message.components:
            found |= {name: msgspec.json.decode(each) for name, each in message.components[component].values.items()}
    return found


async def test_a_protective_stop_ends_what_moves_until_it_is_reset() -> None:
    mode = Mode()
    bench = Bench(mode)
    bench.move("m", arm=2.0)
    await bench.tick(0.2)
    mode.stop_protectively("the safety gate is open")
    await bench.tick(0.5)
    assert bench.end("m").reason == "mode: the safety gate is open"
    refused = bench.move("m2", arm=1.0)
    assert isinstance(refused, Refused)
    assert (refused.code, refused.reason) == ("fault", "mode: the safety gate is open")
    assert last(bench, "mode") == {
        "mode": "automatic", "protectiveStop": True, "reason": "the safety gate is open", "speedScale": 1.0,
    }  # fmt: skip
    stands = bench.robot.positions["arm"]
    bench.operate("r", "reset", component="mode")
    await bench.tick(0.5)
    assert bench.states("r") == ["running", "succeeded"]
    assert bench.robot.positions["arm"] == stands
    assert last(bench, "mode")["protectiveStop"] is False
    assert not isinstance(bench.move("m3", arm=0.0), Refused)


async def test_the_mode_is_set_to_one_of_the_kind() -> None:
    mode = Mode()
    bench = Bench(mode)
    assert isinstance(bench.operate("x", "", "sleep", property="mode", component="mode"), Refused)
    bench.operate("s", "", "manual", property="mode", component="mode")
    await bench.until(lambda: bench.states("s")[-1:] == ["succeeded"])
    assert mode.operational_mode == "manual"
    assert declare(mode).said.semantic_type == LF + "Mode"
