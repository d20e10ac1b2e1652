"""Operators do what a shift asks for, on a desktop and on a phone, each with few clicks or taps.

More such tasks are where their pages are tested: all have the mark ``task``.
"""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser as Chromium
from playwright.sync_api import Page, expect

from authenticated_gateway import SEEN, AuthenticatedGateway, run_authenticated
from browser import LDP, LF
from browser import Browser as Client
from camera_robot import EYE, CameraRobot
from commanding import TURTLE, angle, radian
from fake_robots import FakeRobot, open_session
from page_user import PageUser, log_in
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JOINT = "wrist_3_joint"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Yield a client of a gateway with a live UR5, and a robot with a camera."""
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, client), place.ur5(), open_session(place.zenoh) as session:
        seer = CameraRobot(FakeRobot(session, "seer").confirm_stops()).appear(EYE)
        live(client, "ur5")
        live(client, "seer")
        assert seer
        yield client


@pytest.fixture
def stopped(client: Client) -> Iterator[None]:
    """Nothing holds after the test."""
    yield
    latches = client.page(str(client.page(client.root).one(LF.stopLatches)))
    for each in latches.graph.objects(latches.iri, LDP.contains):
        assert client.http.delete(str(each)).status_code == 204


@pytest.fixture
def rattling(client: Client) -> Iterator[str]:
    """A fault of the UR5, by its title."""
    said = {"about": f"{client.root}ur5/", "title": "The gearbox rattles.", "faultKind": "noise",
            "severity": str(LF.critical)}  # fmt: skip
    assert client.http.post(client.root + "actions/raiseFault", json=said).status_code == 204
    yield "The gearbox rattles."
    container = client.page(str(client.page(client.root).one(LF.faults)))
    for each in container.graph.objects(container.iri, LDP.contains):
        client.http.post(f"{each}/actions/acknowledge")


def at_ur5(operator: PageUser, client: Client) -> Page:
    operator.page.goto(client.robot("ur5").url)
    expect(operator.page.locator("form.motion .slider")).to_have_count(6)
    return operator.page


# -- what is wrong ------------------------------------------------------------------------------------------------


@pytest.mark.task("See on any page that something is wrong, and find what", presses=1)
def test_find_what_is_wrong(operator: PageUser, client: Client, rattling: str) -> None:
    page = operator.page
    page.goto(client.part("ur5", JOINT).url)
    counter = page.locator('.sections .attention[data-severity="critical"]')
    expect(counter).to_be_visible()
    operator.press(page.locator(".sections a", has_text="Faults"))
    expect(page.locator("#faults tbody tr").first).to_contain_text(rattling)
    expect(page.locator("#faults tbody tr").first).to_contain_text("ur5")


@pytest.mark.task("Acknowledge a fault", presses=2)
def test_acknowledge_a_fault(operator: PageUser, client: Client, rattling: str) -> None:
    page = operator.page
    page.goto(client.root)
    operator.press(page.locator(".sections a", has_text="Faults"))
    operator.press(page.locator("#faults tbody tr", has_text=rattling).locator("a[data-acknowledge]"))
    expect(page.locator("#faults tbody tr", has_text=rattling)).to_have_count(0)
    expect(page.locator('.sections .attention[data-severity="critical"]')).to_have_count(0)


@pytest.mark.task("See what led to a fault: the robot as it was", presses=3)
def test_see_what_led_to_a_fault(operator: PageUser, client: Client, rattling: str) -> None:
    page = operator.page
    page.goto(client.root)
    operator.press(page.locator(".sections a", has_text="Faults"))
    operator.press(page.locator("#faults tbody a", has_text=rattling))
    operator.press(page.get_by_role("link", name="In the timeline"))
    expect(page.locator(".replay-robots article").first).to_contain_text("ur5")
    expect(page.locator(".replay-robots tbody tr").first).to_be_visible()


# -- robots -------------------------------------------------------------------------------------------------------


@pytest.mark.task("Move a joint: aim, see what would happen, move", presses=2)
def test_move_a_joint(operator: PageUser, client: Client) -> None:
    page, before = at_ur5(operator, client), angle(client, JOINT)
    row = page.locator(f'.slider[data-joint="{client.part("ur5", JOINT).url}"]')
    box = row.locator("input[type=range]").bounding_box()
    assert box is not None
    operator.press(
        row.locator("input[type=range]"), at=(box["width"] * (0.45 if before > 0 else 0.55), box["height"] / 2)
    )
    expect(page.locator("form.motion .answer")).to_contain_text(
        re.compile(r"would work; nothing has moved.*it would take [\d.]+ s")
    )
    assert angle(client, JOINT) == pytest.approx(before, abs=0.01)
    operator.press(page.locator("form.motion").get_by_role("button", name="Move"))
    expect(page.locator("form.motion .task .state")).to_have_text("succeeded")
    expect(page.locator("#tasks .task")).to_have_count(0)
    order = page.evaluate("[...document.querySelectorAll('#move, #facts')].map((each) => each.id)")
    assert order == ["move", "facts"]
    target = float(row.locator("input[type=number]").input_value())
    assert angle(client, JOINT) == pytest.approx(target * 3.14159 / 180, abs=0.02)


@pytest.mark.task("Bring a robot to a named pose", presses=2)
def test_go_to_a_named_pose(operator: PageUser, client: Client) -> None:
    page = at_ur5(operator, client)
    operator.press(page.get_by_role("button", name="upright"))
    operator.press(page.locator("form.motion").get_by_role("button", name=re.compile("^Move")))
    expect(page.locator("form.motion .task .state")).to_have_text("succeeded")


@pytest.mark.task("Stop a robot, and let it move again", presses=3)
def test_stop_a_robot_and_reset(operator: PageUser, client: Client, stopped: None) -> None:
    page = at_ur5(operator, client)
    operator.press(page.get_by_role("button", name="Stop ur5"))
    bar = page.locator("#latch-bar")
    expect(bar).to_contain_text("The stop of ur5 holds since")
    operator.press(bar.get_by_role("button", name="Reset"))
    operator.press(page.get_by_role("dialog").get_by_role("button", name="Reset"))
    expect(bar).to_have_count(0)


@pytest.mark.task("Stop all robots, from any page", presses=1)
def test_stop_all_robots(operator: PageUser, client: Client, stopped: None) -> None:
    page = operator.page
    page.goto(client.root + "missions")
    operator.press(page.locator("form.stop button"))
    expect(page.locator("#latch-bar")).to_contain_text("all robots")


@pytest.mark.task("Take control of a robot, and give it back", presses=2)
def test_take_control_and_give_it_back(operator: PageUser, client: Client) -> None:
    page = at_ur5(operator, client)
    operator.press(page.locator("#control").get_by_role("button", name="Take control"))
    expect(page.locator("#control")).to_contain_text("You have control.")
    operator.press(page.locator("#control").get_by_role("button", name="Give back"))
    expect(page.locator("#control .state")).to_have_text("free")


@pytest.mark.task("Look through a camera", presses=2)
def test_look_through_a_camera(operator: PageUser, client: Client) -> None:
    page = operator.page
    page.goto(client.root)
    operator.press(page.locator("#robots .card", has_text="seer").locator("h3 a"))
    operator.press(page.locator('a[href$="/cameras/eye"]').first)
    expect(page.locator("#seen > img")).to_be_visible()


@pytest.mark.task("Take a robot out of service, and say why", presses=3)
def test_take_a_robot_out_of_service(operator: PageUser, client: Client) -> None:
    page = at_ur5(operator, client)
    operator.press(page.get_by_role("link", name="Set availability"))
    page.get_by_label("in service").select_option("no")
    operator.press(page.get_by_text("Options", exact=True))
    page.get_by_label("reason").fill("gearbox 3 is worn")
    operator.press(page.get_by_role("button", name="set", exact=True))
    expect(page.locator("output.answer")).to_have_text("Done.")
    operator.finish()
    page.goto(client.root)
    expect(page.locator("#robots .card", has_text="ur5")).to_contain_text("out of service")
    back = client.http.put(client.root + "ur5/availability", json={"inService": True})
    assert back.status_code == 204, back.text


@pytest.mark.task("See what happened in the last hours, and who did it", presses=2)
def test_see_what_happened(operator: PageUser, client: Client) -> None:
    page = operator.page
    rotated = client.http.post(
        client.action(client.part("ur5", JOINT), LF.Rotate), content=radian(0.1), headers=TURTLE | {"prefer": "wait=30"}
    )
    assert rotated.is_success, rotated.text
    page.goto(client.root)
    operator.press(page.locator(".sections a", has_text="Timeline"))
    row = page.locator("#activities tbody tr", has_text=JOINT).first
    expect(row).to_contain_text("succeeded")
    operator.press(row.locator("th a"))
    expect(page.locator("body")).to_have_attribute("data-kind", "invocation")


# -- people -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        yield one


def at_guarded(page: Page, guarded: AuthenticatedGateway, path: str) -> None:
    page.goto(guarded.root + path)
    log_in(page, guarded.tokens["root"])
    expect(page.locator("#who")).to_have_text("root")


@pytest.mark.task("Invite a colleague who may look", presses=1)
def test_invite_a_colleague(operator: PageUser, guarded: AuthenticatedGateway, chromium: Chromium) -> None:
    page = operator.page
    at_guarded(page, guarded, "invitations")
    page.get_by_label("Whom it is for").fill("a colleague")
    operator.press(page.get_by_role("button", name="Make a link"))
    link = page.get_by_label("Send this link").input_value()
    operator.finish()
    with chromium.new_context() as other:
        guest = other.new_page()
        guest.goto(link)
        guest.goto(guarded.root + SEEN + "/")
        expect(guest.locator("form.stop button")).to_be_disabled()


@pytest.mark.task("See who is here, and who has control of what", presses=2)
def test_see_who_is_here(operator: PageUser, guarded: AuthenticatedGateway) -> None:
    page = operator.page
    at_guarded(page, guarded, SEEN + "/")
    page.locator("#control").get_by_role("button", name="Take control").click()
    expect(page.locator("#control")).to_contain_text("You have control.")
    operator.press(page.locator("details.reader summary"))
    operator.press(page.get_by_role("link", name="Who is here"))
    expect(page.get_by_role("row", name=re.compile("^root "))).to_contain_text(SEEN)
    operator.finish()
    page.goto(guarded.root + SEEN + "/")
    page.locator("#control").get_by_role("button", name="Give back").click()
    expect(page.locator("#control .state")).to_have_text("free")
