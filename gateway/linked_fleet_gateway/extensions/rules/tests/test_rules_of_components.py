"""Rules over values and events of components, which invoke their actions."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from browser import LF, Browser
from component_cell import Cell, Grasped
from rules_client import QUERY, a_rule, fired, posted
from running import eventually
from small_fleet import Place, live
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
NARROW = 0.075


@dataclass
class Scene:
    root: str
    cell: Cell
    browser: Browser

    @property
    def colour(self) -> str:
        """The term of the input of the action that paints the lamp."""
        return f"<{self.root}cell/vocabulary#lamp-input-paint-colour>"

    @property
    def narrow(self) -> str:
        """A condition that holds while the fingers are near each other."""
        width = f"<{self.root}cell/gripper/width>"
        return f"SELECT ?x WHERE {{ {width} lf:value/vom:numericalValue ?x FILTER(?x < 0.078) }}"

    def rule(self, condition: str, action: str, body: str = "") -> str:
        rule = posted(self.browser, a_rule(QUERY + condition, f"{self.root}cell/{action}", body))
        eventually(lambda: self.browser.page(rule).one(LF.state) == LF.active, "evaluated")
        return rule


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    place, cell = Place(tmp_path), Cell()
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cell", cell):
        live(browser, "cell")
        eventually(lambda: '"0.08"' in browser.http.get(f"{place.root}cell/gripper").text, "a value")
        yield Scene(place.root, cell, browser)


def test_a_value_of_a_component_invokes_an_action_of_another(scene: Scene) -> None:
    rule = scene.rule(scene.narrow, "lamp/actions/paint", f'{scene.colour} "green"')
    scene.cell.gripper.gap = NARROW
    assert fired(scene.browser, rule, 1) == [("accepted", "")]
    eventually(lambda: scene.cell.lamp.hue == "green", "painted")


def test_an_event_of_a_component_invokes_the_setting_of_a_value(scene: Scene) -> None:
    lost = f"SELECT ?count WHERE {{ <{scene.root}cell/gripper/lost> lf:occurrences ?count FILTER(?count > 0) }}"
    rule = scene.rule(lost, "lamp/actions/on", "lf:value true")
    scene.cell.gripper.lost(Grasped(0.03, False))
    assert fired(scene.browser, rule, 1) == [("accepted", "")]
    eventually(lambda: scene.cell.lamp.lit, "lit")


def test_an_input_that_the_shape_of_the_action_refuses_is_a_failed_firing_with_the_reason(scene: Scene) -> None:
    rule = scene.rule(scene.narrow, "lamp/actions/paint", f'{scene.colour} "blue"')
    scene.cell.gripper.gap = NARROW
    assert fired(scene.browser, rule, 1) == [("failed", "")]
    assert "colour: 'blue' must be one of 'green', 'red'" in scene.browser.http.get(f"{rule}/firings/1").text
    assert scene.cell.lamp.hue == "red"
