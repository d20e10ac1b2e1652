"""What components of a robot said, as it is on disk: values, events, and what held at an instant."""

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyshacl
import pytest
from rdflib import URIRef

from browser import HYBRIT, LF, SOSA, Browser
from component_cell import Cell, Grasped
from linked_fleet_gateway.extensions.history.segment import Said
from linked_fleet_gateway.extensions.history.values import _selected
from running import eventually
from small_fleet import Place, live
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual


@dataclass
class Scene:
    cell: Cell
    browser: Browser
    values: str

    def rows(self, **query: str) -> list[dict[str, str]]:
        answer = self.browser.http.get(self.values, params=query, headers={"accept": "text/csv"})
        assert answer.status_code == 200, answer.text
        return list(csv.DictReader(io.StringIO(answer.text, newline="")))

    def of(self, path: str, **query: str) -> list[str]:
        return [row["value"] for row in self.rows(**query) if row["path"] == path]


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    place, cell = Place(tmp_path), Cell()
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cell", cell):
        live(browser, "cell")
        whole = browser.page(str(browser.robot("cell").one(LF.history)))
        found = Scene(cell, browser, str(whole.one(LF.componentHistory)))
        eventually(lambda: found.of("gripper/width") == ["0.08"], "the first value")
        yield found


def test_values_are_kept_as_they_change_and_events_as_they_occur(scene: Scene) -> None:
    scene.cell.gripper.gap = 0.07
    eventually(lambda: scene.of("gripper/width") == ["0.08", "0.07"], "the change")
    scene.cell.gripper.broken = "no bus"
    eventually(lambda: scene.of("gripper/width")[-1] == "null", "that it is unknown")
    scene.cell.gripper.lost(Grasped(0.05, False))
    lost = eventually(lambda: [row for row in scene.rows() if row["kind"] == "event"], "the event")
    assert (lost[0]["path"].partition("/")[0], lost[0]["value"]) == ("gripper", '{"width":0.05,"holding":false}')
    assert [row["time"] for row in scene.rows()] == sorted(row["time"] for row in scene.rows())


def test_at_an_instant_each_value_is_the_last_one_before_it(scene: Scene) -> None:
    scene.cell.gripper.gap = 0.07
    rows = eventually(lambda: found if len(found := scene.rows()) > 5 else None, "the change")
    first, second = (row["time"] for row in rows if row["path"] == "gripper/width")
    eventually(lambda: scene.of("gripper/width", at=second) == ["0.07"], "the second one")
    assert scene.of("gripper/width", at=second[:-10] + "000000000Z") in (["0.08"], [])
    assert len(scene.rows(at=second)) == 5
    assert scene.rows(at="2020-01-01T00:00:00Z") == [] and first < second


def test_they_are_linked_data_with_the_addresses_of_the_properties(scene: Scene) -> None:
    page = scene.browser.page(scene.values)
    assert {str(each).removeprefix(scene.browser.root) for each in page.graph.objects(None, SOSA.observedProperty)} == {
        "cell/gripper/width", "cell/lamp/on", "cell/lamp/colour", "cell/lamp/pieces", "cell/lamp/count",
    }  # fmt: skip
    (blueprint,) = [each for each in page.graph.objects(page.iri, HYBRIT.blueprint) if each != LF.ComponentHistoryShape]
    shapes = scene.browser.page(str(blueprint)).graph
    conforms, _, text = pyshacl.validate(page.graph, shacl_graph=shapes, inference="none")
    assert conforms, text
    assert page.one(LF.ofRobot) == URIRef(scene.browser.root + "cell/")
    assert scene.browser.http.get(scene.values, headers={"accept": "text/html"}).status_code == 200


@pytest.mark.parametrize(("most", "sizes"), [(2, [2, 2, 1]), (4, [4, 1]), (5, [5])])
def test_pages_keep_what_was_said_at_one_time_together(most: int, sizes: list[int]) -> None:
    from linked_fleet_gateway.extensions.history.span import Span

    class Shelf:
        def values(self, _: str, begin: int, end: int, count: int) -> list[Said]:
            said = [Said("r", f"c/{n}", "value", "1", at) for n, at in enumerate((1, 1, 2, 2, 3))]
            return [each for each in said if begin <= each.stamp_ns < end][:count]

    class Archive:
        shelf = Shelf()

    begin: int | None = 0
    found = []
    while begin is not None:
        some, begin = _selected(Archive(), "r", Span(begin_ns=begin, limit=most), 0)  # type: ignore[arg-type]
        found.append(len(some))
    assert found == sizes
