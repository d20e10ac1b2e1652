"""Values of components are written as they change, and as unknown once what had them is gone."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from linked_fleet_gateway.api import Robot
from linked_fleet_gateway.extensions.components.part import ComponentPart
from linked_fleet_gateway.extensions.history.component_values import ValueWatch

NOW_NS = 9


class Part(ComponentPart):
    """A component with the given values; a value of None is unknown."""

    is_current = True  # type: ignore[assignment]
    declared: Any = None
    state: Any = None

    def __init__(self, name: str, changes: int = 0, **values: object) -> None:
        self.name = name
        self.whole = cast(Any, SimpleNamespace(incarnation=1, changes=changes))
        self.declared = SimpleNamespace(properties=list(values))
        times = {each: 5 for each, value in values.items() if value is not None}
        self.state = SimpleNamespace(value=values.get, times_ns=times, events={})

    def path_of(self, name: str) -> str:
        return f"/r/{self.name}/{name}"


def robot(*parts: Part, presence: str = "online") -> Robot:
    return cast(Robot, SimpleNamespace(name="r", parts={each.name: each for each in parts}, presence=presence))


@pytest.mark.parametrize(
    ("then", "said"),
    [
        (robot(Part("lamp", 1, on=True)), {}),
        (robot(Part("lamp", 1, on=False)), {"lamp/on": "false"}),
        (robot(Part("lamp", 1, on=None)), {"lamp/on": "null"}),
        (robot(Part("lamp", 1, colour=1)), {"lamp/on": "null", "lamp/colour": "1"}),
        (robot(Part("gripper", 1, width=2)), {"lamp/on": "null", "gripper/width": "2"}),
        (robot(), {"lamp/on": "null"}),
        (robot(Part("lamp", on=True), presence="offline"), {"lamp/on": "null"}),
    ],
    ids=["same", "changed", "unknown", "other property", "other component", "no component", "offline"],
)
def test_what_is_gone_is_unknown_from_then_on(then: Robot, said: dict[str, str]) -> None:
    watch = ValueWatch(lambda: NOW_NS)
    assert [(each.path, each.json) for each in watch.look(robot(Part("lamp", on=True)))] == [("lamp/on", "true")]
    found = watch.look(then)
    assert {each.path: each.json for each in found} == said
    assert all(each.stamp_ns == NOW_NS for each in found if each.json == "null")
    assert watch.look(then) == [], "once"
    again = {each.path: each.json for each in watch.look(robot(Part("lamp", 2, on=True)))}
    assert again.get("lamp/on") == (None if said.get("lamp/on") is None else "true")


def test_a_first_value_that_is_unknown_ends_what_was_known_before_a_restart() -> None:
    watch = ValueWatch(lambda: NOW_NS)
    assert [(each.json, each.stamp_ns) for each in watch.look(robot(Part("lamp", on=None)))] == [("null", NOW_NS)]
    assert watch.look(robot(Part("lamp", on=None))) == []


def test_a_robot_without_components_says_nothing() -> None:
    assert ValueWatch().look(robot()) == []
