"""The disk keeps where robots stood and what objects there were; what is not kept is said."""

import base64
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pyshacl
import pytest
from rdflib import Literal, URIRef

from browser import DCTERMS, HYBRIT, LDP, LF, Browser, Page
from component_cell import Cell
from running import eventually
from small_fleet import Place, live
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
TERMS, METRE = "https://w3id.org/linked-fleet#", "http://qudt.org/vocab/unit/M"
MATHS = "http://vocab.arvida.de/2015/06/maths/vocab#"
CORNERS = [(0.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.2, 0.6)]


@dataclass
class Scene:
    place: Place
    browser: Browser

    def at(self, time: str = "") -> Page:
        query = f"?at={time}" if time else ""
        page = self.browser.page(f"{self.browser.root}cell/history/world{query}")
        return replace(page, url=page.url.partition("?")[0])

    def place_robot(self, x: float) -> None:
        answer = self.browser.http.put(f"{self.browser.root}cell/placement", json={"position": metres(x, 0, 0)})
        assert answer.status_code < 300, answer.text

    def add(self, title: str, x: float, **geometry: object) -> str:
        body = {"title": title, "position": metres(x, 0, 0), "geometry": geometry}
        answer = self.browser.http.post(f"{self.browser.root}world/objects", json=body)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def settled(self, what: Callable[[Page], bool]) -> str:
        """Return the time since which the world on disk is so."""
        page = eventually(lambda: found if what(found := self.at()) else None, "the world on disk")
        return str(page.one(LF["from"]))


def metres(x: float, y: float, z: float) -> dict[str, object]:
    return {"x": x, "y": y, "z": z, "unit": METRE}


def mesh(scale: float) -> dict[str, object]:
    triangle = struct.pack("<12f2x", 0, 0, 0, *(scale * each for corner in CORNERS for each in corner))
    stl = base64.b64encode(bytes(80) + struct.pack("<I", 1) + triangle).decode()
    return {"form": f"{TERMS}TriangleMesh", "STL": stl}


def titles(page: Page) -> list[str]:
    things = page.graph.objects(page.iri, LDP.contains)
    return sorted(str(page.graph.value(each, DCTERMS.title)) for each in things)


def is_over(page: Page) -> bool:
    return page.graph.value(page.iri, LF.to) is not None


def x_of(page: Page, iri: object, predicate: object = LF.position) -> float | None:
    for node in page.graph.objects(URIRef(str(iri)), predicate):
        return float(str(page.graph.value(node, URIRef(MATHS + "x"))))
    return None


def box(x: float) -> dict[str, object]:
    return {"form": f"{TERMS}Box", "size": metres(x, x, x)}


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cell", Cell()):
        live(browser, "cell")
        yield Scene(place, browser)


def test_what_was_then_is_told_and_not_what_is_now(scene: Scene) -> None:
    where = f"{scene.browser.root}cell/placement"
    scene.place_robot(1.0)
    crate = scene.add("crate", 2.0, **box(0.5))
    first = scene.settled(lambda page: titles(page) == ["crate"] and x_of(page, where) == 1.0)
    scene.place_robot(5.0)
    scene.browser.http.delete(crate).raise_for_status()
    scene.add("barrel", 3.0, form=f"{TERMS}Sphere", radius={"value": 0.3, "unit": METRE})
    second = scene.settled(lambda page: titles(page) == ["barrel"] and x_of(page, where) == 5.0)
    page = scene.at(first)
    assert titles(page) == ["crate"] and (x_of(page, where), x_of(page, crate)) == (1.0, 2.0)
    assert str(page.one(LF["from"])) == first < str(page.one(LF.to)), "for how long it holds"
    assert titles(scene.at(second)) == ["barrel"]
    assert str(page.one(LF.robotsNotDescribed)) == "0"
    assert not is_over(scene.at(second))


def test_a_shape_that_is_not_kept_is_a_box_around_it_and_says_so(scene: Scene) -> None:
    part = scene.add("part", 1.0, **mesh(1.0))
    then = scene.settled(lambda page: titles(page) == ["part"])
    page = scene.at(then)
    assert page.graph.value(URIRef(part), LF.shapeNotKept) is None, "it has the same shape still"
    assert [str(each) for each in page.graph.objects(None, LF.mesh)] == [part + "/mesh"]
    whole = {"title": "part", "position": metres(1.0, 0, 0), "geometry": mesh(2.0)}
    scene.browser.http.put(part, json=whole).raise_for_status()
    scene.settled(lambda page: not is_over(page) and str(page.one(LF["from"])) > then)
    page = scene.at(then)
    assert page.graph.value(URIRef(part), LF.shapeNotKept) == Literal(True)
    assert x_of(page, part) == pytest.approx(1.2), "the middle of the box"
    (size,) = page.graph.objects(None, LF.size)
    assert float(str(page.graph.value(size, URIRef(MATHS + "x")))) == pytest.approx(0.4)


def test_a_time_of_which_nothing_is_kept_is_unknown(scene: Scene) -> None:
    scene.settled(lambda page: page.one(LF["from"]) != LF.unknown)
    page = scene.at("2020-01-01T00:00:00Z")
    assert page.one(LF["from"]) == LF.unknown and titles(page) == []
    get = scene.browser.http.get
    assert get(f"{scene.browser.root}cell/history/world?last=PT1S").status_code == 400
    assert get(f"{scene.browser.root}cell/history/world", headers={"accept": "text/html"}).status_code == 200


def test_after_a_restart_what_has_gone_meanwhile_is_gone(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cell", Cell()):
        live(browser, "cell")
        scene = Scene(place, browser)
        scene.add("crate", 2.0, **box(0.5))
        before = scene.settled(lambda page: titles(page) == ["crate"])
    with place.gateway() as (_, browser), serving_robot(place.zenoh, "cell", Cell()):
        live(browser, "cell")
        scene = Scene(place, browser)
        for each in browser.page(browser.root + "world/objects").graph.objects(None, LDP.contains):
            browser.http.delete(str(each)).raise_for_status()
        scene.settled(lambda page: page.one(LF["from"]) != LF.unknown and titles(page) == [])
        assert titles(scene.at(before)) == ["crate"]


def test_it_conforms_to_its_blueprint(scene: Scene) -> None:
    scene.place_robot(1.0)
    scene.add("crate", 2.0, **box(0.5))
    scene.settled(lambda page: titles(page) == ["crate"])
    page = scene.at()
    (blueprint,) = [each for each in page.graph.objects(page.iri, HYBRIT.blueprint) if each != LF.PastWorldShape]
    conforms, _, text = pyshacl.validate(page.graph, shacl_graph=scene.browser.page(str(blueprint)).graph)
    assert conforms, text
