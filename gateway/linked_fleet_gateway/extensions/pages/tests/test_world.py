"""The world in 3D: robots and objects are drawn where they are, and follow changes."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect

from browser import LF, MATHS, Browser
from commanding import PREFIXES, TURTLE
from running import eventually
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all, pytest.mark.webgl]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), place.ur5():
        live(browser, "ur5")
        yield browser


def _at(x: float, y: float, z: float) -> str:
    return f"lf:position [ maths:x {x} ; maths:y {y} ; maths:z {z} ; vom:unit unit:M ]"


def _zone(title: str, where: str) -> str:
    geometry = "lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 0.2 ; vom:unit unit:M ] ]"
    return f'{PREFIXES}<> a lf:KeepOutZone ; dcterms:title "{title}" ; {where} ; {geometry} .'


def _standing(page: Page) -> dict[str, list[float]]:
    found: dict[str, list[float]] = page.evaluate("() => document.getElementById('scene').scene.standing()")
    return found


def _rounded(found: dict[str, list[float]]) -> dict[str, list[float]]:
    return {name: [round(each, 6) for each in where] for name, where in found.items()}


def test_objects_of_the_world_are_drawn_and_updated(page: Page, watched: object, browser: Browser) -> None:
    world = browser.page(str(browser.page(browser.root).one(LF.world)))
    page.goto(world.url)
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    assert _standing(page) == {}  # the robot has no placement
    placement = str(browser.robot("ur5").one(LF.placement))
    assert browser.http.put(placement, content=f"{PREFIXES}<> {_at(1, 2, 3)} .", headers=TURTLE).status_code == 204
    eventually(lambda: _rounded(_standing(page)) == {"ur5": [1, 2, 3]}, "the robot where it stands")
    objects = str(world.one(LF.objects))
    made = browser.http.post(objects, content=_zone("people", _at(0, -1, 0.5)), headers=TURTLE)
    eventually(lambda: _rounded(_standing(page)).get("people") == [0, -1, 0.5], "the zone")
    moved = browser.http.put(made.headers["location"], content=_zone("people", _at(0, 1, 0.5)), headers=TURTLE)
    assert moved.status_code == 204
    eventually(lambda: _rounded(_standing(page)).get("people") == [0, 1, 0.5], "the zone elsewhere")


def test_a_robot_is_drawn_among_the_objects_as_it_sees_them(page: Page, watched: object, browser: Browser) -> None:
    placement = str(browser.robot("ur5").one(LF.placement))
    turned = f"{_at(1, 2, 0)} ; lf:orientation [ maths:x 0 ; maths:y 0 ; maths:z 1 ; lf:w 0 ]"
    assert browser.http.put(placement, content=f"{PREFIXES}<> {turned} .", headers=TURTLE).status_code == 204
    objects = str(browser.page(str(browser.page(browser.root).one(LF.world))).one(LF.objects))
    made = browser.http.post(objects, content=_zone("ball", _at(2, 2, 0.5)), headers=TURTLE)
    assert made.status_code == 201
    page.goto(browser.robot("ur5").url)
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")

    def seen() -> list[float] | None:
        return page.evaluate(  # type: ignore[no-any-return]
            """() => {
                const { around } = document.getElementById("scene").scene;
                const ball = around?.visible && around.children.find(({ name }) => name === "ball");
                if (!ball) return null;
                ball.updateWorldMatrix(true, false);
                return ball.matrixWorld.elements.slice(12, 15).map((each) => Math.round(each * 1e6) / 1e6);
            }"""
        )

    assert eventually(seen, "the ball") == [-1, 0, 0.5]


def test_what_a_link_holds_is_drawn_where_the_link_is(page: Page, watched: object, browser: Browser) -> None:
    placement = str(browser.robot("ur5").one(LF.placement))
    assert browser.http.put(placement, content=f"{PREFIXES}<> {_at(1, 2, 0)} .", headers=TURTLE).status_code == 204
    world = browser.page(str(browser.page(browser.root).one(LF.world)))
    link = f"{browser.root}ur5/wrist_3_link"
    held = f"lf:heldBy <{link}> ; lf:inFrame <{link}> ; {_at(0, 0, 0.3)}"
    body = _zone("tool", held).replace("lf:KeepOutZone", "lf:Obstacle")
    made = browser.http.post(str(world.one(LF.objects)), content=body, headers=TURTLE)
    assert made.status_code == 201, made.text
    pose = browser.page(f"{browser.root}world/pose?of={made.headers['location']}")
    there = [float(str(pose.graph.value(pose.graph.value(pose.iri, LF.position), MATHS[axis]))) for axis in "xyz"]
    page.goto(world.url)
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    drawn = eventually(lambda: _standing(page).get("tool"), "what the robot holds")
    assert drawn == pytest.approx(there, abs=5e-3)
    expect(page.locator("[data-things] li small").last).to_contain_text("held by wrist_3_link")
