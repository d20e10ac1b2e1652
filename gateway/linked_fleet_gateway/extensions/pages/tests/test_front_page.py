"""The front page: the world on top, loaded on demand and drawn while visible; a click leads to a robot."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect

from browser import LF
from browser import Browser as Client
from chromium import PHONE
from commanding import PREFIXES, TURTLE, of_joint, radian, slowly
from running import PATIENCE_S, eventually
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all, pytest.mark.webgl]
LOW: ViewportSize = {"width": 1280, "height": 320}
MIDDLE = """() => {
    const { view, robots } = document.getElementById("scene").scene;
    const [robot] = robots.values();
    robot.place.updateWorldMatrix(true, true);
    let mesh;
    robot.robot.links.base_link_inertia?.traverse((each) => (mesh ??= each.isMesh ? each : undefined));
    robot.robot.traverse((each) => (mesh ??= each.isMesh ? each : undefined));
    mesh.geometry.computeBoundingSphere();
    const at = mesh.geometry.boundingSphere.center.clone().applyMatrix4(mesh.matrixWorld).project(view.camera);
    const { left, top, width, height } = view.canvas.getBoundingClientRect();
    return [left + ((at.x + 1) / 2) * width, top + ((1 - at.y) / 2) * height];
}"""
TIMES = """() => {
    const { pacing } = document.getElementById("scene").scene.view;
    const draw = pacing.draw;
    window.times = [];
    pacing.draw = (now) => {
        window.times.push(now);
        draw(now);
    };
}"""
COUNT = """() => {
    const { view } = document.getElementById("scene").scene;
    const draw = view.draw;
    window.drawn = 0;
    view.draw = (...given) => {
        window.drawn += 1;
        draw.apply(view, given);
    };
}"""


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, client), place.ur5():
        live(client, "ur5")
        body = f"{PREFIXES}<> lf:position [ maths:x 0 ; maths:y 0 ; maths:z 0 ; vom:unit unit:M ] ."
        assert client.http.put(str(client.robot("ur5").one(LF.placement)), content=body, headers=TURTLE).is_success
        yield client


@pytest.fixture
def front(page: Page, watched: object, client: Client) -> Page:
    page.goto(client.root)
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    return page


def test_the_scene_shows_the_activity_of_each_robot(front: Page) -> None:
    label = front.locator(".scene-names a")
    expect(label).to_be_visible()
    expect(label).to_contain_text("ur5")
    expect(label).to_contain_text("online")


def test_a_click_leads_to_the_robot(front: Page, client: Client) -> None:
    x, y = front.evaluate(MIDDLE)
    front.mouse.click(x, y)
    front.wait_for_url(client.robot("ur5").url)


def test_a_double_click_follows_the_robot(front: Page, client: Client) -> None:
    x, y = front.evaluate(MIDDLE)
    front.mouse.dblclick(x, y)
    leave = front.get_by_role("button", name="show all")
    expect(leave).to_be_visible()
    expect(front.locator("#scene")).to_have_attribute("data-following", "ur5")
    placement = str(client.robot("ur5").one(LF.placement))
    before = front.evaluate("() => document.getElementById('scene').scene.view.controls.target.toArray()")
    body = f"{PREFIXES}<> lf:position [ maths:x 2 ; maths:y 0 ; maths:z 0 ; vom:unit unit:M ] ."
    assert client.http.put(placement, content=body, headers=TURTLE).is_success

    def shifted() -> bool:
        now = front.evaluate("() => document.getElementById('scene').scene.view.controls.target.toArray()")
        return bool(abs(now[0] - before[0] - 2) < 0.01)

    eventually(shifted, "the camera beside the robot")
    assert front.url == client.root
    leave.click()
    expect(leave).to_have_count(0)
    expect(front.locator("#scene")).to_have_attribute("data-following", "")


def test_the_keyboard_follows_a_robot_and_lets_go(front: Page) -> None:
    """By the key F at its name, or at the drawing, where it goes from one robot to the next."""
    scene, said = front.locator("#scene"), front.locator(".scene-view [role=status]")
    label = front.locator(".scene-names a")
    expect(label).to_be_visible()  # what is hidden takes no focus
    label.focus()
    front.keyboard.press("f")
    expect(scene).to_have_attribute("data-following", "ur5")
    expect(said).to_contain_text("Following")
    front.get_by_role("button", name="show all").press("Enter")
    expect(scene).to_have_attribute("data-following", "")
    front.locator("#scene canvas").focus()
    front.keyboard.press("f")
    expect(scene).to_have_attribute("data-following", "ur5")
    front.keyboard.press("f")
    expect(scene).to_have_attribute("data-following", "")
    expect(said).to_contain_text("All of the world")


def test_nothing_is_drawn_while_it_is_not_seen(front: Page, client: Client) -> None:
    front.set_viewport_size(LOW)
    front.evaluate("() => (document.querySelector('main').style.paddingBottom = '2000px')")
    front.evaluate(COUNT)
    front.evaluate("() => scrollTo(0, document.documentElement.scrollHeight)")
    eventually(lambda: front.evaluate("() => !document.getElementById('scene').scene.inSight"), "out of sight")
    # Frames requested before it became invisible may still be drawn: their timers and callbacks come before these.
    front.evaluate(
        "() => new Promise((done) => setTimeout(() => requestAnimationFrame(() => requestAnimationFrame(done)), 300))"
    )
    front.evaluate("() => (window.drawn = 0)")
    answer = client.http.put(of_joint(client, "wrist_3_joint"), content=radian(0.4), headers=TURTLE)
    assert answer.is_success, answer.text
    moved = front.locator("#robots [data-moved] time")
    expect(moved).to_have_count(1)
    assert front.evaluate("() => window.drawn") == 0
    front.evaluate("() => scrollTo(0, 0)")
    eventually(lambda: front.evaluate("() => window.drawn") > 0, "a drawing")


def test_a_processor_draws_at_most_fifteen_times_a_second(front: Page, client: Client) -> None:
    """Here it has to; a graphics card draws with the screen."""
    assert front.evaluate("() => document.getElementById('scene').scene.view.pacing.software")
    front.evaluate(TIMES)
    for angle in (1.5, 0.4):
        body = slowly(angle, speed=0.5)
        answer = client.http.put(
            of_joint(client, "wrist_3_joint"), content=body, headers=TURTLE | {"prefer": "wait=30"}, timeout=40
        )
        assert answer.is_success, answer.text
        front.wait_for_timeout(100)  # the time until its events arrive
    times = front.evaluate("() => window.times")
    assert len(times) > 2
    assert min(after - before for before, after in pairwise(times)) > 0.9 * 1000 / 15


def test_the_first_page_is_light(front: Page, client: Client) -> None:
    """The first page and all its scripts are within the limit, which does not count meshes of robots."""
    weights = front.evaluate(
        """() => [...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")]
            .map(({ name, encodedBodySize }) => [name, encodedBodySize])"""
    )
    ours = [size for name, size in weights if "/model/" not in name and "/mesh" not in name]
    assert sum(ours) < 300_000, weights


def test_a_phone_draws_the_world_when_it_is_asked_for(chromium: Browser, client: Client) -> None:
    context = chromium.new_context(
        viewport=PHONE, has_touch=True, is_mobile=True, reduced_motion="reduce", device_scale_factor=0.5
    )
    context.set_default_timeout(PATIENCE_S * 1000)
    page = context.new_page()
    fetched: list[str] = []
    page.on("request", lambda request: fetched.append(request.url))
    page.goto(client.root, wait_until="networkidle")
    expect(page.locator("#robots .card")).to_have_count(1)
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    assert not [each for each in fetched if "scene_world" in each]
    page.get_by_role("button", name="Show the world").tap()
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    context.close()


def test_robots_are_shown_side_by_side_while_nobody_has_placed_any(page: Page, watched: object, tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, client), place.ur5():
        live(client, "ur5")
        page.goto(client.root)
        badge = page.locator(".scene-badge")
        expect(badge).to_have_text("Nobody has placed the robots: they are shown side by side. Place them")
        expect(page.locator(".scene-names a")).to_contain_text("ur5")
        expect(badge.get_by_role("link", name="Place them")).to_have_attribute("href", f"{client.root}world")
        body = f"{PREFIXES}<> lf:position [ maths:x 0 ; maths:y 0 ; maths:z 0 ; vom:unit unit:M ] ."
        assert client.http.put(str(client.robot("ur5").one(LF.placement)), content=body, headers=TURTLE).is_success
        page.reload()
        expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
        expect(page.locator(".scene-badge")).to_be_hidden()
