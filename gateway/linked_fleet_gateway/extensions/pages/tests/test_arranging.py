"""The page of the world: objects are added, dragged, changed and deleted, robots are placed, and motions avoid them."""

import re
from collections.abc import Callable, Iterator
from typing import Protocol

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from browser import LF, MATHS
from browser import Browser as Client
from commanding import PREFIXES, TURTLE
from graphs import read
from page_user import PageUser
from running import eventually
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all, pytest.mark.webgl]
REACH_M = 0.5
JOINT = "shoulder_pan_joint"


class Forgiving(Protocol):
    """The console of a page, as recorded by conftest.py."""

    def forgive(self, *texts: str) -> None: ...


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, client), place.ur5():
        live(client, "ur5")
        put = client.http.put(str(client.robot("ur5").one(LF.placement)), content=_at(0, 0, 0), headers=TURTLE)
        assert put.status_code == 204
        yield client


CRATE = """() => {
    const { view, all } = document.getElementById("scene").scene;
    const { left, top, width, height } = view.canvas.getBoundingClientRect();
    const at = all.position.clone().set(2, 0, 0.2).project(view.camera);
    return [left + ((at.x + 1) / 2) * width, top + ((1 - at.y) / 2) * height];
}"""


@pytest.fixture
def world(page: Page, watched: Forgiving, client: Client) -> Page:
    page.goto(str(client.page(client.root).one(LF.world)))
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    return page


def _at(x: float, y: float, z: float) -> str:
    return f"{PREFIXES}<> lf:position [ maths:x {x} ; maths:y {y} ; maths:z {z} ; vom:unit unit:M ] ."


def _coordinate(form: Locator, axis: str) -> Locator:
    return form.locator(f'fieldset[data-path="{LF.position}"] input[data-path$="#{axis}"]')


def _add(
    page: Page,
    title: str,
    position: tuple[float, float, float],
    press: Callable[[Locator], None] = Locator.click,
) -> Locator:
    """Add an object by two clicks and some typing."""
    press(page.locator("#objects > details > summary"))
    form = page.locator("#objects > details form.invoke")
    form.get_by_label("title").fill(title)
    for axis, value in zip("xyz", position, strict=True):
        _coordinate(form, axis).fill(str(value))
    press(form.get_by_role("button", name="add", exact=True))
    expect(form.locator("output.answer")).to_contain_text(f"Done: {title}")
    made = form.get_by_role("link", name=title, exact=True).get_attribute("href")
    return page.locator(f'[data-thing="{made}"]')


def _placed(client: Client, iri: str) -> tuple[float, ...]:
    page = client.page(iri)
    graph, node = page.graph, page.graph.value(page.iri, LF.position)
    return tuple(float(str(graph.value(node, MATHS[axis]))) for axis in "xyz")


def _standing(page: Page) -> dict[str, list[float]]:
    found: dict[str, list[float]] = page.evaluate("() => document.getElementById('scene').scene.standing()")
    return {name: [round(each, 3) for each in where] for name, where in found.items()}


def _over_the_gizmo(page: Page) -> bool:
    """Return True once the gizmo has been drawn and can be grabbed."""
    x, y = page.evaluate(CRATE)
    page.mouse.move(x + 1, y)
    page.mouse.move(x, y)
    return bool(page.evaluate("() => document.getElementById('scene').scene.chooser.quiet()"))


def _iri(item: Locator) -> str:
    iri = item.get_attribute("data-thing")
    assert iri is not None
    return iri


def test_an_object_is_added_dragged_and_deleted(world: Page, client: Client) -> None:
    item = _add(world, "crate", (2, 0, 0.2))
    iri = _iri(item)
    assert _placed(client, iri) == (2, 0, 0.2)
    eventually(lambda: _standing(world).get("crate") == [2, 0, 0.2], "the crate in the scene")
    item.locator("summary").click()
    form = item.locator("form.invoke")
    expect(_coordinate(form, "x")).to_have_value("2.0")
    eventually(lambda: _over_the_gizmo(world), "the gizmo below the pointer")
    x, y = world.evaluate(CRATE)
    world.mouse.down()
    world.mouse.move(x + 40, y, steps=4)
    world.mouse.up()
    expect(_coordinate(form, "x")).not_to_have_value("2.0")
    dragged = tuple(float(_coordinate(form, axis).input_value()) for axis in "xyz")
    assert _standing(world)["crate"] == [round(each, 3) for each in dragged]
    assert _placed(client, iri) == (2, 0, 0.2)  # until somebody saves it
    form.get_by_role("button", name="save").click()
    expect(form.locator("output.answer")).to_have_text("Done.")
    assert _placed(client, iri) == pytest.approx(dragged, abs=1e-4)
    item.get_by_role("button", name="Delete crate").click()
    world.get_by_role("dialog").get_by_role("button", name="Delete").click()
    expect(item).to_have_count(0)
    assert client.http.get(iri).status_code == 404


def test_a_concurrent_change_is_not_overwritten(world: Page, watched: Forgiving, client: Client) -> None:
    item = _add(world, "shelf", (3, 0, 0.2))
    item.locator("summary").click()
    form = item.locator("form.invoke")
    _coordinate(form, "x").fill("4")
    description = client.http.get(_iri(item), headers={"accept": "text/turtle"}).text
    changed = client.http.put(_iri(item), content=description.replace("shelf", "rack"), headers=TURTLE)
    assert changed.status_code == 204, changed.text
    form.get_by_role("button", name="save").click()
    expect(form.locator("output.answer")).to_contain_text("has changed since")
    watched.forgive("412")
    assert _placed(client, _iri(item)) == (3, 0, 0.2)


def test_a_form_has_the_fields_of_its_geometry(world: Page) -> None:
    world.locator("#objects > details > summary").click()
    form = world.locator("#objects > details form.invoke")
    expect(form.get_by_role("group", name="size")).to_be_visible()
    form.get_by_label("form").select_option("cylinder")
    expect(form.get_by_role("group", name="size")).to_be_hidden()
    expect(form.get_by_role("group", name="radius")).to_be_visible()
    expect(form.get_by_role("group", name="length")).to_be_visible()


def test_a_robot_is_placed_by_numbers(world: Page, client: Client) -> None:
    placement = str(client.robot("ur5").one(LF.placement))
    details = world.locator("#robots details")
    details.locator("summary").click()
    form = details.locator("form.invoke")
    _coordinate(form, "y").fill("1.5")
    eventually(lambda: _standing(world)["ur5"] == [0, 1.5, 0], "the robot where it is about to be placed")
    form.get_by_role("button", name="set").click()
    expect(form.locator("output.answer")).to_have_text("Done.")
    assert _placed(client, placement) == (0, 1.5, 0)
    assert client.http.put(placement, content=_at(0, 0, 0), headers=TURTLE).status_code == 204


def test_the_page_can_be_read_without_scripts(chromium: Browser, client: Client) -> None:
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(str(client.page(client.root).one(LF.world)))
    expect(page.get_by_role("heading", name="Robots")).to_be_visible()
    page.get_by_role("link", name="Objects and zones").click()
    expect(page.get_by_role("heading", name="Add an object or a zone")).to_be_visible()
    context.close()


def _before_it(client: Client) -> tuple[float, float, float]:
    """Return a place that the wrist passes in a half turn, from poses in the world."""
    link = str(client.part("ur5", "wrist_1_link").url)
    world = client.page(str(client.page(client.root).one(LF.world)))
    answer = client.http.get(str(world.one(LF.poses)), params={"of": link}, headers={"accept": "text/turtle"})
    graph = read(answer.content, str(answer.url))
    (node,) = graph.objects(None, LF.position)
    x, y, z = (float(str(graph.value(node, MATHS[axis]))) for axis in "xyz")
    return round(-y, 3), round(x, 3), round(z, 3)  # a quarter turn further


@pytest.mark.task("Put a crate into the world, and see that a motion would meet it", presses=4)
def test_a_crate_is_placed_and_a_motion_refused(operator: PageUser, client: Client) -> None:
    """Open the form, save it, go to the robot, and set a joint: four clicks or taps."""
    page = operator.page
    page.goto(str(client.page(client.root).one(LF.world)))
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    assert operator.fits()
    crate = _iri(_add(page, "crate", _before_it(client), operator.press))
    operator.press(page.locator("#robots h3 a"))
    expect(page.locator("form.motion .slider")).to_have_count(6)
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    row = page.locator(f'.slider[data-joint="{client.part("ur5", JOINT).url}"]')
    track = row.locator("input[type=range]")
    box = track.bounding_box()
    assert box is not None
    operator.press(track, at=(box["width"] * 0.75, box["height"] / 2))
    answer = page.locator("form.motion .answer")
    expect(answer).to_contain_text(re.compile(r"would meet crate \(obstacle\) after \d+ % of the way"))
    links = {each.get_attribute("href") for each in answer.get_by_role("link").all()}
    assert crate in links
    assert len(links) == 2
    expect(page.locator("#scene")).to_have_attribute("data-contact", "")
    operator.finish()
    page.goto(str(client.page(client.root).one(LF.world)))
    refused = page.locator("#collisions li")
    expect(refused).to_contain_text("would meet crate (obstacle)")
    assert {each.get_attribute("href") for each in refused.get_by_role("link").all()} == links
    expect(page.locator("#scene")).to_have_attribute("data-contacts", "1")
    operator.forgive("409")
    assert client.http.delete(crate).status_code == 204
