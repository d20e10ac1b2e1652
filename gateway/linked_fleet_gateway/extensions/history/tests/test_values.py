"""Values and events of components are read from disk, and those that held at an instant."""

import asyncio
import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import dropwhile
from pathlib import Path
from typing import Any

import pyshacl
import pytest
from rdflib import URIRef

from browser import HYBRIT, LF, SOSA, Browser
from component_cell import Cell, Grasped
from linked_fleet_gateway.extensions.history import sending, values
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
        """Return the values of a property from the first known one on."""
        return [row["value"] for row in self.of_path(path, **query)]

    def of_path(self, path: str, **query: str) -> list[dict[str, str]]:
        rows = [row for row in self.rows(**query) if row["path"] == path]
        return list(dropwhile(lambda row: row["value"] == "null", rows))


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


def test_the_values_of_one_property_are_selected_and_thinned_out(scene: Scene) -> None:
    for gap in (0.07, 0.06, 0.05):
        scene.cell.gripper.gap = gap
        eventually(lambda gap=gap: scene.of("gripper/width")[-1] == str(gap), "the change")
    scene.cell.gripper.broken = "no bus"
    eventually(lambda: scene.of("gripper/width")[-1] == "null", "that it is unknown")
    assert {row["path"] for row in scene.rows()} > {"gripper/width"}
    selected = scene.rows(of="gripper/width")
    assert [row["value"] for row in selected if row["value"] != "null"] == ["0.08", "0.07", "0.06", "0.05"]
    assert {row["path"] for row in selected} == {"gripper/width"}
    thinned = [row["value"] for row in scene.rows(of="gripper/width", every="PT1H", last="PT1H")]
    assert thinned[-2:] == ["0.08", "null"], "where it becomes known and unknown stays"
    assert [row["value"] for row in scene.rows(of="gripper/width", at=selected[-2]["time"])] == ["0.05"]
    assert scene.rows(of="gripper/nothing") == []
    get = scene.browser.http.get
    assert get(scene.values, params={"every": "PT1S"}).status_code == 400
    assert get(f"{scene.values}?of=a&of=b").status_code == 400
    first = get(scene.values, params={"of": "gripper/width", "limit": "1", "every": "PT0.5S", "last": "PT1H"})
    (following,) = (each["url"] for each in first.links.values() if each["rel"] == "next")
    assert "of=gripper%2Fwidth" in following and "every=PT0.5S" in following


def test_at_an_instant_each_value_is_the_last_one_before_it(scene: Scene) -> None:
    scene.cell.gripper.gap = 0.07
    rows = eventually(lambda: found if len(found := scene.of_path("gripper/width")) > 1 else None, "the change")
    first, second = (row["time"] for row in rows)
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


@pytest.mark.parametrize("query", [{"last": "P400Y"}, {"from": "9999-01-01T00:00:00Z"}, {"to": "0001-01-01T00:00:00Z"}])
def test_times_at_the_ends_of_all_times_are_answered(scene: Scene, query: dict[str, str]) -> None:
    whole = scene.values.removesuffix("/values")
    for address in (scene.values, whole, f"{whole}?as=csv"):
        assert scene.browser.http.get(address, params=query).status_code == 200
    for at in ("9999-01-01T00:00:00Z", "0001-01-01T00:00:00Z"):
        assert scene.rows(at=at) == []
        assert scene.browser.http.get(whole, params={"at": at}).status_code == 200


@pytest.mark.parametrize("media_type", ["text/turtle", "text/html", "text/csv"])
def test_they_are_written_in_a_thread(scene: Scene, monkeypatch: pytest.MonkeyPatch, media_type: str) -> None:
    read, run, in_thread, depth = values.read_resource, asyncio.to_thread, list[bool](), list[None]()

    def reading(*of: Any) -> Any:
        in_thread.append(bool(depth))
        return read(*of)

    async def running(work: Callable[..., Any], *of: Any) -> Any:
        def noted() -> Any:
            depth.append(None)
            try:
                return work(*of)
            finally:
                depth.pop()

        return await run(noted)

    monkeypatch.setattr(values, "read_resource", reading)
    monkeypatch.setattr(asyncio, "to_thread", running)
    first = scene.browser.http.get(scene.values, headers={"accept": media_type})
    again = scene.browser.http.get(scene.values, headers={"accept": media_type, "if-none-match": first.headers["etag"]})
    assert first.status_code == 200 and again.status_code in (200, 304) and in_thread == [True, True]


def test_long_pages_take_one_of_the_places_of_long_histories(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene.cell.gripper.gap = 0.07
    eventually(lambda: len(scene.of("gripper/width")) > 1, "the change")
    usual, slots = sending._Pieces, list[object]()
    monkeypatch.setattr(sending, "_PIECE_BYTES", 10)
    monkeypatch.setattr(sending, "_Pieces", lambda response, slot: slots.append(slot) or usual(response, slot))
    answer = scene.browser.http.get(scene.values, params={"limit": "1", "last": "PT1H"})
    assert answer.status_code == 200 and 'rel="next"' in answer.headers["link"] and len(slots) == 1
