"""The floor from above, on a desktop and on a phone: loaded by a form, read without seeing it, and followed."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from accessibility import violations_in_both_schemes
from browser import LF, Browser
from commanding import PREFIXES, TURTLE
from floor_maps import FREE, UNKNOWN, WALL, pgm, yaml
from page_user import PageUser
from running import ROOT, eventually, process
from scene_client import put_robot
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JSON = {"accept": "application/json"}
ROWS = [[WALL] * 6, *([[WALL, FREE, FREE, FREE, UNKNOWN, UNKNOWN]] * 4)]
CRATE = f"""{PREFIXES}
<> a lf:Obstacle ; dcterms:title "crate" ; lf:position [ maths:x 1 ; maths:y 0.5 ; maths:z 0.3 ; vom:unit unit:M ] ;
    lf:geometry [ a lf:Box ; lf:size [ maths:x 0.4 ; maths:y 0.6 ; maths:z 0.6 ; vom:unit unit:M ] ] .
"""


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Yield a client of a gateway with a base that drives, and a crate."""
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, client), process(str(ROOT / "examples/base.py"), "--connect", place.zenoh):
        live(client, "cart")
        world = client.page(str(client.page(client.root).one(LF.world)))
        assert client.http.post(str(world.one(LF.objects)), content=CRATE, headers=TURTLE).status_code == 201
        yield client


def relocalise(client: Browser, x: float, y: float, degrees: float) -> None:
    metre, degree = (f"http://qudt.org/vocab/unit/{each}" for each in ("M", "DEG"))
    body = {"position": {"x": x, "y": y, "unit": metre}, "heading": {"value": degrees, "unit": degree}}
    answer = client.http.post(f"{client.root}cart/actions/relocalise", json=body)
    assert answer.status_code == 204, answer.text


def test_a_map_is_loaded_and_robots_are_followed_on_it(operator: PageUser, client: Browser, tmp_path: Path) -> None:
    page = operator.page
    assert client.http.delete(f"{client.root}world/map").status_code == 204
    relocalise(client, 1.0, -1.0, 90.0)
    page.goto(client.root + "world")
    operator.press(page.get_by_role("link", name="Floor plan"))
    expect(page.locator("#floor-said")).to_have_text("No map of the floor, 1 robot, 1 object")
    (tmp_path / "floor.yaml").write_bytes(yaml(0.5, (-0.5, -1.5, 0.0)))
    (tmp_path / "floor.pgm").write_bytes(pgm(ROWS))
    form = page.locator("form[data-upload]")
    form.get_by_label("YAML").set_input_files(tmp_path / "floor.yaml")
    form.get_by_label("image", exact=True).set_input_files(tmp_path / "floor.yaml")
    operator.press(form.get_by_role("button", name="Load it"))
    expect(form.locator("output")).to_contain_text("names the image 'floor.pgm', and the file sent is 'floor.yaml'")
    form.get_by_label("image", exact=True).set_input_files(tmp_path / "floor.pgm")
    form.get_by_label("title").fill("Hall 2")
    operator.press(form.get_by_role("button", name="Load it"))
    expect(form.locator("output")).to_have_text("The map is in use.")
    expect(page.locator("#floor-said")).to_have_text("Map Hall 2, 1 robot, 1 object")
    expect(page.locator("#floor svg image")).to_have_attribute("width", "3")

    def rows() -> list[str]:
        return [" ".join(each.split()) for each in page.locator("#floor tbody tr").all_inner_texts()]

    eventually(lambda: rows() == ["cart base 1.00 m, -1.00 m 90°", "crate obstacle 1.00 m, 0.50 m"], "both in words")
    assert page.locator("#floor svg a polygon").count() == 2, "its footprint, and where it looks"
    relocalise(client, 0.5, -1.0, -45.0)
    eventually(lambda: rows()[0] == "cart base 0.50 m, -1.00 m -45°", "the cart elsewhere")
    assert page.locator("#floor svg a g").get_attribute("transform").startswith("translate(0.5 1) rotate(45")
    operator.forgive("422")


def test_charging_stations_stand_where_their_base_would(operator: PageUser, tmp_path: Path) -> None:
    page, place = operator.page, Place(tmp_path)
    agent = ("-m", "linked_fleet_agent", "--robot=pmb2", "--connect", place.zenoh)
    with place.gateway() as (_, client), process(*agent):
        live(client, "pmb2")
        put_robot(client, "pmb2", 2.0, 1.0, 0.0, math.pi / 2)
        page.goto(client.root + "world/map")
        row = page.locator("#floor tbody tr").filter(has_text="charging station of pmb2").first
        expect(row).to_be_visible()
        base = eventually(lambda: client.http.get(f"{client.root}pmb2/mobile_base", headers=JSON).json(), "the base")
        station = base["stations"][0]
        x, y = 2.0 - station["y"], 1.0 + station["x"]
        expect(row).to_contain_text(f"{x:.2f} m, {y:.2f} m")
        assert page.locator("#floor svg polygon.station").count() == len(base["stations"])
        page.goto('data:text/html,<meta name="viewport" content="width=device-width">')  # before the gateway ends


def test_nobody_is_shut_out_and_nothing_scrolls_sideways(operator: PageUser, client: Browser) -> None:
    page = operator.page
    page.set_viewport_size({"width": 360, "height": 740})
    page.goto(client.root + "world/map")
    expect(page.locator("[data-floor]")).to_have_attribute("data-phase", "ready")
    assert violations_in_both_schemes(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    operator.press(page.get_by_role("button", name="Nearer"))
    plan = page.locator(".floor-plan")
    assert plan.evaluate("(plan) => plan.scrollWidth > 1.5 * plan.clientWidth"), "it scrolls within its frame"
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    operator.press(page.get_by_role("button", name="Show all"))
    assert plan.evaluate("(plan) => plan.scrollWidth === plan.clientWidth")


@pytest.mark.webgl
def test_the_map_lies_below_the_scene(operator: PageUser, client: Browser, tmp_path: Path) -> None:
    files = {"yaml": yaml(0.5, (-0.5, -1.5, 0.0)), "image": ("floor.pgm", pgm(ROWS))}
    assert client.http.put(f"{client.root}world/map", files=files).status_code == 204
    page = operator.page
    page.goto(client.root + "world")
    drawn = "() => document.getElementById('scene').scene?.floor?.children.length"
    eventually(lambda: page.evaluate(drawn) == 1, "the map in the scene")
    where = page.evaluate(
        "() => { const { floor } = document.getElementById('scene').scene; return floor.position.toArray(); }"
    )
    assert where == [-0.5, -1.5, 0]
    assert client.http.delete(f"{client.root}world/map").status_code == 204
    eventually(lambda: page.evaluate(drawn) == 0, "no map any more")
