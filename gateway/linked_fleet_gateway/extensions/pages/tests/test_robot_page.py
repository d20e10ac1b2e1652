"""Commanding a robot on its page, counted in clicks and taps: sliders, named poses, reach, control, history."""

import json
import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Locator, Page, Route, expect

from browser import LF
from browser import Browser as Client
from commanding import TURTLE, angle, control
from running import eventually
from scene_client import crate, placement, put_object, put_robot
from small_fleet import move
from watched_page import Watched

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JOINT, METRE = "wrist_3_joint", "http://qudt.org/vocab/unit/M"
GIZMO_HEIGHT = """() => {
    let height;
    document.getElementById("scene").scene.view.scene.traverse((each) => {
        if (each.isTransformControlsRoot) height = each.controls.object.position.z;
    });
    return height;
}"""
DRAWN = "name => document.getElementById('scene').scene.translucent.copy.joints[name].angle"


@pytest.fixture
def robot(page: Page, watched: object, client: Client) -> Page:
    page.goto(client.robot("ur5").url)
    expect(page.locator("form.motion .slider")).to_have_count(6)
    return page


def slider(page: Page, client: Client, joint: str = JOINT) -> Locator:
    return page.locator(f'.slider[data-joint="{client.part("ur5", joint).url}"]')


def test_enter_in_a_number_field_tries_and_does_not_move(robot: Page, client: Client) -> None:
    row, form = slider(robot, client), robot.locator("form.motion")
    before = angle(client, JOINT)
    row.locator("input[type=number]").fill("20")
    row.locator("input[type=number]").press("Enter")
    expect(form.locator(".answer")).to_contain_text("nothing has moved")
    expect(form.locator(".task")).to_have_count(0)
    assert angle(client, JOINT) == pytest.approx(before, abs=0.01)
    form.get_by_role("button", name="Reset").click()


def test_a_named_pose_aims_all_joints(robot: Page, client: Client) -> None:
    """It does not move by itself; Reset makes the sliders follow the robot again."""
    before = angle(client, "shoulder_lift_joint")
    robot.get_by_role("button", name="upright").click()
    form = robot.locator("form.motion")
    expect(form.get_by_role("button", name="Move 6 joints")).to_be_visible()
    expect(form.locator(".answer")).to_contain_text("nothing has moved")
    form.get_by_role("button", name="Reset").click()
    expect(form.locator(".slider[data-aimed]")).to_have_count(0)
    assert angle(client, "shoulder_lift_joint") == pytest.approx(before, abs=0.01)


@pytest.mark.webgl
def test_a_ghost_stands_where_the_robot_would_be(robot: Page, client: Client) -> None:
    expect(robot.locator("#scene")).to_have_attribute("data-phase", "ready")
    row = slider(robot, client)
    row.locator("input[type=number]").fill("45")
    expect(robot.locator("#scene[data-ghost]")).to_be_visible()
    assert robot.evaluate(DRAWN, JOINT) == pytest.approx(0.785, abs=0.01)
    robot.locator("form.motion").get_by_role("button", name="Reset").click()
    expect(robot.locator("#scene[data-ghost]")).to_have_count(0)


def ghost_at(along: Locator, share: float) -> float:
    """Return where the elbow of the ghost is once the slider of a path is at a share of its time."""
    along.evaluate("(e, s) => { e.value = String(e.max * s); e.dispatchEvent(new Event('input')); }", share)
    found: float = along.page.evaluate(DRAWN, "elbow_joint")
    return found


def open_reach(robot: Page) -> tuple[Locator, Locator]:
    """Open the form of reach, and return it with its field for the height of the target, which has a value."""
    expect(robot.locator("#scene")).to_have_attribute("data-phase", "ready")
    details = robot.locator("details[data-reach]")
    details.locator("summary").click()
    form = details.locator("form.invoke")
    height = form.locator(f'fieldset[data-path="{LF.position}"] input[data-path$="#z"]')
    expect(height).to_have_value(re.compile(r"^0\.\d+"))
    return form, height


@pytest.mark.webgl
def test_reach_begins_at_the_tip_and_takes_numbers(robot: Page, client: Client) -> None:
    """Dragging and typing set the same target; the outcome is shown as a ghost."""
    form, height = open_reach(robot)
    assert re.search(r"(ee_link|tool0)$", form.locator(f'select[data-path="{LF.ofLink}"]').input_value())
    lower = f"{float(height.input_value()) - 0.05:.4f}"
    height.fill(lower)
    form.get_by_role("button", name="Try without moving").click()
    expect(form.locator(".answer")).to_contain_text("It would work")
    expect(robot.locator("#scene[data-ghost]")).to_be_visible()
    form.get_by_role("button", name="reach", exact=True).click()
    expect(form.locator(".task .state")).to_have_text("succeeded")


@pytest.fixture
def placed(client: Client) -> Iterator[None]:
    """Place the robot, without which nothing is planned, while the test lasts."""
    put_robot(client, "ur5", 0, 0, 0)
    yield
    assert client.http.delete(placement(client, "ur5")).status_code == 204


@pytest.mark.webgl
def test_the_ghost_moves_along_a_planned_path(placed: None, robot: Page) -> None:
    form, height = open_reach(robot)
    form.locator("summary", has_text="Options").click()
    form.locator(f'select[data-path="{LF.path}"]').select_option(label="straight")
    height.fill(f"{float(height.input_value()) - 0.05:.4f}")
    form.get_by_role("button", name="Try without moving").click()
    answer = form.locator(".answer")
    expect(answer).to_contain_text("on a planned path: a straight line was asked for")
    expect(answer).to_contain_text("off the line by at most")
    along = answer.locator("input[type=range]")
    seen = [ghost_at(along, share) for share in (0, 0.5, 1)]
    assert len(set(seen)) == 3 and (seen[0] - seen[1]) * (seen[1] - seen[2]) > 0
    answer.get_by_role("button", name="Play the path").click()
    end = float(along.get_attribute("max") or 0)
    expect(answer.locator("output")).to_have_text(f"{end:.1f} s of {end:.1f} s")
    assert robot.evaluate(DRAWN, "elbow_joint") == pytest.approx(seen[2], abs=1e-3)


@pytest.mark.webgl
def test_the_ghost_moves_along_the_planned_paths_of_a_mission(placed: None, robot: Page, client: Client) -> None:
    """In the builder, which draws the robot as its page does."""
    form, _ = open_reach(robot)
    named = [form.locator(f'fieldset[data-path="{LF.position}"] input[data-path$="#{axis}"]') for axis in "xyz"]
    x, y, z = (float(each.input_value()) for each in named)
    link = form.locator(f'select[data-path="{LF.ofLink}"]').input_value()
    ways = [{"x": x, "y": y, "z": z - down, "unit": METRE} for down in (0.05, 0.0)]
    bodies = [{"link": link, "position": way, "path": LF.Straight} for way in ways]
    steps = [{"type": "invoke", "action": f"{client.root}ur5/actions/reach", "body": body} for body in bodies]
    said = {"title": "down and up", "step": {"type": "sequence", "steps": steps}}
    mission = client.http.post(client.root + "missions", json=said).headers["location"]
    robot.goto(f"{client.root}missions/builder?mission={mission.rpartition('/')[2]}")
    robot.locator("button.step").nth(1).click()
    robot.locator(".robot-view").scroll_into_view_if_needed()
    expect(robot.locator("#scene")).to_have_attribute("data-phase", "ready")
    elbow = robot.evaluate("() => document.getElementById('scene').scene.robot.joints.elbow_joint.angle")
    assert elbow == pytest.approx(angle(client, "elbow_joint"), abs=0.01)
    robot.get_by_role("button", name="Rehearse").click()
    expect(robot.locator(".step-row .note").first).to_contain_text("on a planned path: a straight line was asked for")
    along = robot.locator(".robot-view input[type=range]")
    start, half_down, half_up, end = (ghost_at(along, share) for share in (0, 0.25, 0.75, 1))
    assert start == pytest.approx(elbow, abs=0.01) and end == pytest.approx(elbow, abs=0.01)
    assert abs(half_down - start) > 0.005 and half_down == pytest.approx(half_up, abs=0.01)
    robot.locator("button.step").nth(1).click()
    low = robot.evaluate(DRAWN, "elbow_joint")
    assert abs(low - start) > abs(half_down - start)
    assert float(along.input_value()) == pytest.approx(float(along.get_attribute("max") or 0) / 2, rel=0.05)


def test_what_was_shown_is_carried_out(placed: None, robot: Page, client: Client, watched: Watched) -> None:
    """The form sends the plan of the dry run; once the robot stands elsewhere, it is refused, and asked for again."""
    put_object(client, crate("crate", 0.9, 0.9, 0.2))
    robot.goto(client.robot("ur5").url + "actions/reach")
    form = robot.locator("form.invoke")
    form.locator(f'select[data-path="{LF.ofLink}"]').select_option(value=client.part("ur5", "ee_link").url)
    form.locator(f'fieldset[data-path="{LF.position}"] select[data-path$="#unit"]').select_option(label="m")
    for axis, value in zip("xyz", ("0.4", "0.1", "0.5"), strict=True):
        form.locator(f'fieldset[data-path="{LF.position}"] input[data-path$="#{axis}"]').fill(value)
    form.locator("summary", has_text="Options").click()
    form.locator(f'select[data-path="{LF.path}"]').select_option(label="planned")
    dry = form.get_by_role("button", name="Try without moving")
    go = form.get_by_role("button", name="reach", exact=True)
    dry.click()
    expect(form.locator(".answer")).to_contain_text("this very motion is kept")
    expect(form.locator(".answer")).to_contain_text(re.compile("closest after .* of ur5 and crate"))
    sends = re.compile("POST|PUT").fullmatch
    robot.route("**/actions/reach", lambda route: route.abort(), times=1)
    with robot.expect_request(lambda asked: bool(sends(asked.method))) as lost:
        go.click()
    expect(form.locator(".answer")).to_contain_text("No answer")
    watched.forgive("Failed to load resource")
    with robot.expect_request(lambda asked: bool(sends(asked.method))) as sent:
        go.click()
    assert f"<{LF.plan}>" in (sent.value.post_data or "") and sent.value.post_data == lost.value.post_data
    assert sent.value.headers["idempotency-key"] == lost.value.headers["idempotency-key"]
    expect(form.locator(".task .state")).to_have_text("succeeded")
    dry.click()
    expect(form.locator(".answer")).to_contain_text("this very motion is kept")
    before = angle(client, JOINT)
    moved = move(client, client.action(client.part("ur5", JOINT), LF.Rotate), before + 0.1)
    assert moved.status_code == 204, moved.text
    eventually(lambda: abs(angle(client, JOINT) - before - 0.1) < 0.002, "the joint elsewhere")
    go.click()
    expect(form.locator(".answer")).to_contain_text(re.compile("the path begins at|is moving"))
    watched.forgive("409 (Conflict)")
    with robot.expect_request(lambda asked: bool(sends(asked.method))) as sent:
        go.click()
    assert f"<{LF.plan}>" not in (sent.value.post_data or "")
    expect(form.locator(".task .state")).to_have_text("succeeded")


def test_a_refusal_offers_to_look_for_a_way_round(robot: Page, client: Client, watched: Watched) -> None:
    """The gateway says what the same request may have in addition."""
    robot.goto(client.robot("ur5").url + "actions/reach")
    form = robot.locator("form.invoke")

    def refuse(route: Route) -> None:
        if route.request.method == "GET":
            route.fallback()
            return
        said = {"title": "The motion would end in a collision", "status": 409, "retryWith": [{"path": str(LF.Planned)}]}
        route.fulfill(status=409, content_type="application/problem+json", body=json.dumps(said))

    robot.route(lambda url: url.endswith("/actions/reach"), refuse)
    for axis in "xyz":
        form.locator(f'fieldset[data-path="{LF.position}"] input[data-path$="#{axis}"]').fill("300")
    form.get_by_role("button", name="Try without moving").click()
    again = form.get_by_role("button", name="Look for a way round it")
    with robot.expect_request(lambda request: str(LF.Planned) in (request.post_data or "")):
        again.click()
    expect(again).to_be_visible()
    watched.forgive("409 (Conflict)")


@pytest.mark.webgl
@pytest.mark.parametrize("in_sight", [True, False])
def test_after_a_reach_the_form_and_the_gizmo_are_where_the_robot_is(
    robot: Page, client: Client, in_sight: bool
) -> None:
    """A scene out of sight is not drawn, and a drawing is behind the frames: neither may bring the former pose back."""
    form, height = open_reach(robot)
    if not in_sight:
        robot.evaluate("() => document.getElementById('scene').scene.seen(false)")
    target = float(height.input_value()) - 0.05
    height.fill(f"{target:.4f}")
    form.get_by_role("button", name="reach", exact=True).click()
    expect(form.locator(".task .state")).to_have_text("succeeded")

    def shown() -> list[float]:
        return [float(height.input_value()), robot.evaluate(GIZMO_HEIGHT)]

    eventually(lambda: shown() == pytest.approx([target, target], abs=0.002), "form and gizmo at the measured pose")
    robot.wait_for_timeout(500)  # the time of some more frames
    assert shown() == pytest.approx([target, target], abs=0.002)
    form.get_by_role("button", name="Try without moving").click()
    expect(form.locator(".answer")).to_contain_text(re.compile(r"it would take 0(\.\d+)? s"))


def test_nothing_can_be_sent_while_another_has_control(robot: Page, client: Client) -> None:
    lease = str(client.robot("ur5").one(LF.lease))
    taken = client.http.put(lease, content=control("Ada", 60), headers=TURTLE)
    assert taken.is_success, taken.text
    move = robot.locator("form.motion button[data-send]")
    try:
        expect(move).to_be_disabled()
        expect(move).to_have_attribute("title", "Ada has control of the robot: this would be refused.")
    finally:
        client.http.delete(lease, headers={"lock-token": taken.headers["lock-token"]})
    expect(move).to_have_attribute("title", "")


def test_a_negative_number_is_not_clipped(robot: Page, client: Client) -> None:
    field = slider(robot, client).locator("input[type=number]")
    field.fill("-135.0")
    assert field.evaluate("(each) => each.scrollWidth <= each.clientWidth")
    robot.locator("form.motion").get_by_role("button", name="Reset").click()


def test_the_past_is_drawn_when_the_page_opens(robot: Page, client: Client) -> None:
    figure = robot.locator("figure.chart")
    figure.scroll_into_view_if_needed()
    eventually(lambda: int(figure.get_attribute("data-remembered") or 0) > 5, "the past")
    expect(figure.locator("fieldset input:checked")).to_have_count(3)
    figure.get_by_label("wrist_1_joint").check()
    expect(figure.locator("[role=img]")).to_have_attribute("aria-label", re.compile("wrist_1_joint"))
    for name in ("CSV", "MCAP"):
        with robot.expect_download() as download:
            figure.get_by_role("link", name=name).click()
        assert download.value.suggested_filename == f"ur5-history.{name.lower()}"


def test_a_message_about_a_robot_is_small(page: Page, watched: object, client: Client) -> None:
    """Values arrive as frames; the description comes once, and again only when it changes."""
    sizes: dict[str, list[int]] = {}
    page.on(
        "websocket",
        lambda socket: socket.on(
            "framereceived", lambda data: sizes.setdefault(socket.url.partition("?")[0], []).append(len(data))
        ),
    )
    page.goto(client.robot("ur5").url)
    state = client.robot("ur5").url.replace("http", "ws") + "jointState"

    def framed() -> bool:
        page.wait_for_timeout(100)  # the time until its events arrive
        return bool(sizes.get(state))

    eventually(framed, "frames")
    assert max(sizes[state]) < 1000
    assert len(sizes[client.robot("ur5").url.replace("http", "ws")]) == 1


def test_without_webgl_the_page_says_so(robot: Page) -> None:
    robot.locator("#scene").scroll_into_view_if_needed()
    expect(robot.locator("#scene")).to_have_attribute("data-phase", "failed")
    expect(robot.locator("#scene [role=status]")).to_contain_text("no WebGL")
    expect(robot.locator("#scene canvas")).to_have_count(0)
