"""Tasks of an operator on a desktop and on a phone, counted in clicks or taps, and in drags."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, ViewportSize, expect

from browser import LF
from browser import Browser as Client
from commanding import TURTLE, of_joint, of_robot, slowly
from running import PATIENCE_S, eventually

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
SIZES: dict[str, ViewportSize] = {"desk": {"width": 1280, "height": 900}, "phone": {"width": 390, "height": 844}}
# Where the target is on the screen that is dragged in the scene of a robot.
TARGET = """() => {
    const { view, robot } = document.getElementById("scene").scene;
    const point = robot.children.find((each) => each.children.some(({ type }) => type === "AxesHelper"));
    if (!point) return null;
    const at = point.getWorldPosition(point.position.clone()).project(view.camera);
    const { left, top, width, height } = view.canvas.getBoundingClientRect();
    return [left + ((at.x + 1) / 2) * width, top + ((1 - at.y) / 2) * height];
}"""


class Operator:
    """Somebody at a page, who clicks or taps; ``made`` counts that."""

    def __init__(self, page: Page, size: str) -> None:
        self.page, self.touch, self.made = page, size == "phone", 0

    def press(self, place: Locator) -> None:
        self.made += 1
        (place.tap if self.touch else place.click)()

    def drag(self, x: float, y: float, right: int) -> None:
        self.made += 1
        if not self.touch:
            self.page.mouse.move(x, y)
            self.page.mouse.down()
            self.page.mouse.move(x + right, y, steps=4)
            self.page.mouse.up()
            return
        session = self.page.context.new_cdp_session(self.page)
        places = [x, *(x + right * step / 4 for step in range(1, 5))]
        for kind, place in zip(("touchStart", *["touchMove"] * 4), places, strict=True):
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": place, "y": y}]})
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


@pytest.fixture(params=list(SIZES))
def operator(request: pytest.FixtureRequest, chromium: Browser, no_webgl: str) -> Iterator[Operator]:
    """Whose pages say nothing on the console and are not wider than their screen."""
    touch, said = request.param == "phone", []
    context = chromium.new_context(
        viewport=SIZES[request.param],
        has_touch=touch,
        is_mobile=touch,
        reduced_motion="reduce",
        device_scale_factor=0.5,
    )
    context.set_default_timeout(PATIENCE_S * 1000)
    if request.node.get_closest_marker("webgl") is None:
        context.add_init_script(no_webgl)
    page = context.new_page()
    page.on("console", lambda message: message.type in ("error", "warning") and said.append(message.text))
    yield Operator(page, request.param)
    assert page.evaluate("document.documentElement.scrollWidth") == SIZES[request.param]["width"]
    assert [each for each in said if "closed before the connection is established" not in each] == []
    context.close()


@pytest.fixture
def moving(client: Client) -> Iterator[str]:
    """An invocation that takes longer than its test."""
    answer = client.http.post(of_joint(client, "shoulder_pan_joint"), content=slowly(3.0, speed=0.02), headers=TURTLE)
    assert answer.is_success, answer.text
    yield answer.headers["location"]
    client.http.post(of_robot(client, LF.StopRobot))


def test_what_moves_is_found_with_one_click(operator: Operator, client: Client, moving: str) -> None:
    """The card of the robot says what it does; a press on it leads to the robot, whose page shows how far that is."""
    page = operator.page
    page.goto(client.root)
    card = page.locator("#robots .card", has=page.locator(".activity.busy"))
    expect(card).to_contain_text("shoulder_pan_joint")
    thumbnail = card.locator("img.thumbnail")
    assert thumbnail.evaluate("async (image) => { await image.decode(); return image.naturalWidth; }") > 0
    before = thumbnail.get_attribute("src")
    eventually(_changed(thumbnail, before), "another pose on the card")
    operator.press(card.get_by_role("link"))
    expect(page.locator("#tasks .task, .task").first).to_contain_text("shoulder_pan_joint")
    assert operator.made == 1


def _changed(image: Locator, before: str | None) -> Callable[[], bool]:
    def look() -> bool:
        image.page.wait_for_timeout(100)  # which is when its events come
        return image.get_attribute("src") != before

    return look


@pytest.mark.webgl
def test_a_point_is_reached_in_the_scene(operator: Operator, client: Client) -> None:
    """Open *reach*, drag its target, whereupon a dry run says what would happen, and send it."""
    page = operator.page
    page.goto(client.robot("ur5").url)
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    details = page.locator("details[data-reach]")
    operator.press(details.locator("summary"))
    form = details.locator("form.invoke")
    height = form.locator(f'fieldset[data-path="{LF.position}"] input[data-path$="#y"]')
    eventually(lambda: page.evaluate(TARGET), "the target in the scene")
    before = height.input_value()
    page.locator("#scene canvas").scroll_into_view_if_needed()
    eventually(_drawn(page), "a drawing of the target")
    operator.drag(*page.evaluate(TARGET), right=-6)
    expect(height).not_to_have_value(before)
    expect(form.locator(".answer")).to_contain_text("It would work")
    operator.press(form.get_by_role("button", name="reach", exact=True))
    expect(form.locator(".task .state")).to_have_text("succeeded")
    assert operator.made == 3


def _drawn(page: Page) -> Callable[[], Any]:
    """The gizmo can be taken hold of once it was drawn where it is."""
    drawn = "() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => resolve(true))))"
    return lambda: page.evaluate(drawn)


def test_a_recording_is_downloaded_with_one_click(operator: Operator, client: Client) -> None:
    page = operator.page
    page.goto(client.robot("ur5").url)
    figure = page.locator("figure.chart")
    figure.scroll_into_view_if_needed()
    eventually(lambda: int(figure.get_attribute("data-remembered") or 0) > 5, "the past")
    with page.expect_download() as download:
        operator.press(figure.get_by_role("link", name="MCAP"))
    assert download.value.suggested_filename == "ur5-history.mcap"
    assert download.value.path().read_bytes().startswith(b"\x89MCAP")
    assert operator.made == 1
