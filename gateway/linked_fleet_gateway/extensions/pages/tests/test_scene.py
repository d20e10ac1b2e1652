"""The robot in 3D: its links are drawn at the poses from the gateway, and its parts lead to their pages."""

import functools
import math
import signal
from collections.abc import Callable, Iterator
from typing import TypedDict
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Page, expect

from browser import LF, MATHS, Browser
from commands import PREFIXES
from fake_robots import FakeRobot, joint, link, open_session, robot
from linked_fleet_state.kinematics import ORIGIN, LinkPoses
from linked_fleet_state.model import RobotModel
from running import Process, eventually, process
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all, pytest.mark.webgl]
TOLERANCE_M = 0.001
XML = {"accept": "application/xml"}


class Drawn(TypedDict):
    """The contents of a scene at one moment: joint positions in rad or m, places of links in m."""

    positions: dict[str, float]
    links: dict[str, list[float]]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Place, Browser]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser):
        yield place, browser


@pytest.fixture
def ur5(place: tuple[Place, Browser]) -> Iterator[tuple[Browser, Process]]:
    with place[0].ur5() as agent:
        live(place[1], "ur5")
        yield place[1], agent


def _show(page: Page, url: str) -> None:
    page.goto(url)
    page.locator("#scene").scroll_into_view_if_needed()
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")


def _drawn(page: Page, links: list[str]) -> Drawn:
    drawn: Drawn = page.evaluate(
        """links => {
            const { scene } = document.getElementById("scene");
            return { positions: scene.positions(), links: Object.fromEntries(links.map(l => [l, scene.worldOf(l)])) };
        }""",
        links,
    )
    return drawn


def _places(browser: Browser, name: str, links: list[str]) -> dict[str, list[float]]:
    """Return the places of links according to the gateway."""
    found = {}
    for each in links:
        pose = browser.page(str(browser.part(name, each).one(LF.pose)))
        vector = pose.graph.value(pose.iri, LF.position)
        found[each] = [float(str(pose.graph.value(vector, axis))) for axis in (MATHS.x, MATHS.y, MATHS.z)]
    return found


def _agree(drawn: dict[str, list[float]], said: dict[str, list[float]]) -> bool:
    return all(math.dist(drawn[each], said[each]) < TOLERANCE_M for each in said)


def _kinematics(browser: Browser, name: str) -> Callable[[dict[str, float]], dict[str, list[float]]]:
    """Return a function from joint positions to places of links, as computed by the gateway."""
    urdf = browser.http.get(str(browser.robot(name).one(LF.model)), headers=XML).text
    model = RobotModel.parse(urdf)

    def places(positions: dict[str, float]) -> dict[str, list[float]]:
        poses = LinkPoses(model, positions, ORIGIN)
        return {each: list(pose.position_m) for each in model.links if (pose := poses.pose(each)) is not None}

    return places


def _spot(page: Page, name: str) -> tuple[float, float]:
    """Return a point of the window where a link is visible, waiting for it."""
    look = functools.partial(
        page.evaluate,
        """name => {
            const { left, top, width, height } = document.querySelector("#scene canvas").getBoundingClientRect();
            const { scene } = document.getElementById("scene");
            const bottom = Math.min(top + height, innerHeight);
            for (let y = Math.max(top, 0) + 4; y < bottom; y += 6)
                for (let x = left + 4; x < left + width; x += 6)
                    if ([0, 3].every((d) => scene.linkAt(x + d, y + d) === name)) return [x + 1.5, y + 1.5];
        }""",
        name,
    )
    spot = eventually(look, f"{name} is seen")
    return spot[0], spot[1]


def test_links_are_drawn_where_the_gateway_says_while_they_move_and_after(
    page: Page, watched: object, ur5: tuple[Browser, Process]
) -> None:
    browser, _ = ur5
    elbow, links = browser.part("ur5", "elbow_joint"), ["upper_arm_link", "forearm_link", "tool0"]
    _show(page, browser.robot("ur5").url)
    eventually(lambda: _agree(_drawn(page, links)["links"], _places(browser, "ur5", links)), "the pose at the start")
    places = _kinematics(browser, "ur5")
    start = _drawn(page, links)["positions"]["elbow_joint"]
    target = start - 1.2
    slowly = f"lf:speed [ vom:numericalValue 0.2 ; vom:unit unit:RAD-PER-SEC ] ; vom:numericalValue {target}"
    body = f"{PREFIXES} <> {slowly} ; vom:unit unit:RAD ."
    action = browser.action(elbow, LF.Rotate)
    assert browser.http.put(action, content=body, headers={"content-type": "text/turtle"}).status_code < 300

    seen = set()

    def there() -> bool:
        drawn = _drawn(page, links)
        said = places(drawn["positions"])
        assert _agree(drawn["links"], {each: said[each] for each in links}), (drawn, said)
        seen.add(round(drawn["positions"]["elbow_joint"], 2))
        return abs(drawn["positions"]["elbow_joint"] - target) < TOLERANCE_M

    eventually(there, "the scene follows the elbow")
    assert any(target + 0.1 < each < start - 0.1 for each in seen), "it was never seen on its way"
    eventually(lambda: _agree(_drawn(page, links)["links"], _places(browser, "ur5", links)), "the pose at the end")


def test_a_robot_that_walks_is_drawn_where_it_stands(page: Page, watched: object, place: tuple[Place, Browser]) -> None:
    there, browser = place
    links = ["base", "FL_foot", "RR_calf"]
    with process("-m", "linked_fleet_agent", "--robot=go2", "--connect", there.zenoh):
        _show(page, live(browser, "go2").url)
        eventually(lambda: _agree(_drawn(page, links)["links"], _places(browser, "go2", links)), "it stands")
        assert _drawn(page, links)["links"]["base"][2] > 0.2


def test_a_click_finds_the_object_before_the_next_drawing(
    page: Page, watched: object, ur5: tuple[Browser, Process]
) -> None:
    _show(page, ur5[0].robot("ur5").url)
    before, after = page.evaluate(
        """async () => {
            const { scene } = document.getElementById("scene");
            const drawn = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
            const { left, top, width, height } = document.querySelector("#scene canvas").getBoundingClientRect();
            const places = Array.from({ length: 400 }, (_, i) => [(i % 20) / 20, Math.floor(i / 20) / 20]);
            const look = () => places.map(([x, y]) => scene.linkAt(left + x * width, top + y * height) ?? "");
            scene.view.turn(1, 0);
            await drawn();
            scene.view.fit();
            const before = look();
            await drawn();
            return [before, look()];
        }"""
    )
    assert any(after)
    assert before == after


def test_a_part_says_what_it_is_and_a_click_goes_to_its_page(
    page: Page, watched: object, ur5: tuple[Browser, Process]
) -> None:
    browser, _ = ur5
    home = browser.robot("ur5").url
    _show(page, home)
    spot = _spot(page, "forearm_link")
    page.mouse.move(*spot)
    label = page.locator(".scene-label")
    expect(label).to_contain_text("forearm_link")
    expect(label).to_contain_text("elbow_joint")
    expect(label.locator("data")).to_contain_text("rad")
    page.mouse.click(*spot)
    expect(page).to_have_url(browser.part("ur5", "elbow_joint").url)
    _show(page, home)
    page.keyboard.down("Shift")
    page.mouse.click(*_spot(page, "forearm_link"))
    expect(page).to_have_url(browser.part("ur5", "forearm_link").url)


def test_colours_have_a_legend_in_words(page: Page, watched: object, ur5: tuple[Browser, Process]) -> None:
    browser, _ = ur5
    _show(page, browser.robot("ur5").url)
    legend = page.locator(".scene-legend")
    expect(legend).to_be_hidden()
    page.get_by_label("limit proximity").check()
    expect(legend).to_contain_text("at a limit")
    expect(legend).to_contain_text("most: ")
    page.get_by_role("radio", name="effort").check()
    expect(legend).to_contain_text("all that is allowed")
    page.get_by_label("appearance").check()
    expect(legend).to_be_hidden()


def test_keys_turn_and_zoom(page: Page, watched: object, ur5: tuple[Browser, Process]) -> None:
    browser, _ = ur5
    _show(page, browser.robot("ur5").url)
    canvas = page.get_by_role("img", name="3D drawing of")
    canvas.focus()
    seen = {str(_camera(page))}
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.keyboard.press(key)
        seen.add(str(_camera(page)))
    assert len(seen) == 4
    page.keyboard.press("0")
    assert str(_camera(page)) in seen


def _camera(page: Page) -> list[float]:
    place: list[float] = page.evaluate("document.getElementById('scene').scene.view.camera.position.toArray()")
    return [round(each, 6) for each in place]


def test_a_robot_that_left_is_drawn_as_it_was_last_seen(
    page: Page, watched: object, ur5: tuple[Browser, Process]
) -> None:
    browser, agent = ur5
    url, links = browser.robot("ur5").url, ["forearm_link", "tool0"]
    _show(page, url)
    eventually(lambda: _agree(_drawn(page, links)["links"], _places(browser, "ur5", links)), "the present pose")
    last = _drawn(page, links)["links"]
    agent.send(signal.SIGKILL)
    expect(page.locator(".scene-badge")).to_contain_text("offline")
    assert _agree(_drawn(page, links)["links"], last)
    _show(page, url)
    expect(page.locator(".scene-badge")).to_contain_text("offline")
    assert _agree(_drawn(page, links)["links"], last)


def _stick(name: str, child: str, z: float) -> str:
    return joint(name, "revolute", "base" if name == "hip" else "thigh", child).replace("0 0 1", f"0.2 0 {z}", 1)


def test_a_robot_without_meshes_is_drawn_from_its_frames(
    page: Page, watched: object, place: tuple[Place, Browser]
) -> None:
    """An unmeasured joint is named, and does not move."""
    urdf = robot(link("base"), link("thigh"), link("shin"), _stick("hip", "thigh", 0.5), _stick("knee", "shin", 0.4))
    with open_session(place[0].zenoh) as session:
        actor = FakeRobot(session, "sticks")
        actor.appear(actor.description(urdf, ("hip", "knee"))).stand(0.3, math.nan)
        _show(page, live(place[1], "sticks").url)
        eventually(lambda: _drawn(page, [])["positions"].get("hip") == 0.3, "the hip is drawn where it is")
        for each in ("base", "thigh", "shin"):
            _spot(page, each)
        expect(page.locator(".scene-unknown")).to_have_text("Position unknown: knee")
        assert _drawn(page, [])["positions"]["knee"] == 0


BODY = "<visual><geometry>{}</geometry></visual>"
HOSTILE = (
    BODY.format('<mesh filename="http://192.0.2.1/foreign.stl"/>')
    + BODY.format('<mesh filename="//192.0.2.1/foreign.dae"/>')
    + '<visual><geometry><box size="0.2 0.2 0.2"/></geometry>'
    '<material name="&lt;img src=x onerror=alert(1)&gt;"><texture filename="http://192.0.2.1/t.png"/></material></visual>'
)


def test_nothing_is_asked_of_another_host(page: Page, watched: object, place: tuple[Place, Browser]) -> None:
    """Primitives are drawn regardless of what is beside them; names are plain text."""
    name = "<img src=x>"
    urdf = robot(link("base"), f'<link name="{name.replace("<", "&lt;")}">{HOSTILE}</link>')
    urdf = urdf.replace("</robot>", joint("elbow", "revolute", "base", name.replace("<", "&lt;")) + "</robot>")
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    with open_session(place[0].zenoh) as session:
        actor = FakeRobot(session, "hostile")
        actor.appear(actor.description(urdf, ("elbow",))).stand(0.0)
        _show(page, live(place[1], "hostile").url)
        page.mouse.move(*_spot(page, name))
        expect(page.locator(".scene-label")).to_contain_text(f"link {name}")
        expect(page.locator(".scene-label img")).to_have_count(0)
    assert {urlsplit(each).netloc for each in asked} == {urlsplit(place[0].root).netloc}
