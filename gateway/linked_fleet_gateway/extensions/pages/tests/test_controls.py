"""Controls whose requests would be refused are disabled and say why: without the right, under another's control."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, Route, expect

from authenticated_gateway import SEEN, AuthenticatedGateway, run_authenticated
from browser import LF
from browser import Browser as Client
from commanding import TURTLE, WRIST, control, of_joint, of_robot
from page_user import log_in

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
MOVES = "You have no right to move this robot."
CHANGES = "You have no right to change this."
FOLLOWS = "You have no right to have messages sent or rules followed."
SEND = "form.invoke button[type=submit]:not([data-prefer])"
HELD = "Ada has control of the robot: this would be refused."


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    """Yield a gateway with accounts for each right, beside those to read and subscribe."""
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        for name, rights in (("reader", ()), ("stopper", ("stop",)), ("mover", ("act",)), ("keeper", ("admin",))):
            one.add(name, "read", "subscribe", *rights)
            one.known(name)
        one.add("looker", "read", "stop")
        one.known("looker")
        yield one


@dataclass
class Pages:
    """Pages of a guarded gateway, found by links with all rights, for one reader."""

    page: Page
    guarded: AuthenticatedGateway

    def open(self, reader: str, address: str) -> Page:
        self.page.goto("about:blank")  # a page whose session is over reloads itself
        self.page.context.clear_cookies()
        self.page.goto(address)
        self.page.get_by_label("Token", exact=True).fill(self.guarded.tokens[reader])
        self.page.get_by_role("button", name="Log in").click()
        expect(self.page.locator("#who")).to_have_text(reader)
        return self.page


@pytest.fixture
def pages(page: Page, guarded: AuthenticatedGateway) -> Pages:
    return Pages(page, guarded)


def closed(button: Locator, reason: str) -> None:
    expect(button).to_be_disabled()
    expect(button).to_have_attribute("title", reason)


def not_changed(button: Locator) -> None:
    closed(button, CHANGES)


def enabled(button: Locator) -> None:
    expect(button).to_be_enabled()


def opened(page: Page, name: str) -> Locator:
    """Open the section of this name, and return the button of its form that sends."""
    details = page.locator("details.action").filter(has=page.get_by_text(name, exact=True)).first
    details.locator("summary").click()
    return details.locator(SEND)


def test_a_robot_is_moved_by_those_who_may(pages: Pages, guarded: AuthenticatedGateway) -> None:
    """On its page, and on those of a joint and of an action."""
    with guarded.browsing("root") as root:
        robot, joint = root.robot(SEEN).url, root.part(SEEN, WRIST).url
        rotate, stop = of_joint(root, WRIST, robot=SEEN), of_robot(root, LF.StopRobot, robot=SEEN)
    page = pages.open("stopper", robot)
    closed(page.locator("form.motion button[data-send]"), MOVES)
    closed(page.get_by_role("button", name="Take control"), MOVES)
    for pose in page.locator("button[data-pose]").all():
        closed(pose, MOVES)
    expect(page.locator("form.motion p.closed")).to_have_text(MOVES)
    expect(page.locator("form.stop button")).to_be_enabled()
    page.goto(joint)
    closed(opened(page, "rotate"), MOVES)
    expect(opened(page, "hold")).to_be_enabled()
    page.goto(rotate)
    closed(page.locator(SEND), MOVES)
    page.goto(stop)
    expect(page.locator(SEND)).to_be_enabled()
    page = pages.open("mover", rotate)
    expect(page.locator(SEND)).to_be_enabled()
    page.goto(robot)
    expect(page.locator("form.motion button[data-send]")).to_have_attribute("title", "")  # nothing is aimed so far
    expect(page.get_by_role("button", name="Take control")).to_be_enabled()


def test_nothing_is_stopped_without_the_right(pages: Pages, guarded: AuthenticatedGateway) -> None:
    """Neither by the button of each page nor by its key nor by an action."""
    with guarded.browsing("root") as root:
        robot, stop = root.robot(SEEN).url, of_robot(root, LF.StopRobot, robot=SEEN)
    for address in (guarded.root, robot):
        page = pages.open("reader", address)
        closed(page.locator("form.stop button"), "You have no right to stop what is stopped here.")
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")
        expect(page.locator("form.stop output")).to_have_text("")
    page.goto(stop)
    closed(page.locator(SEND), "You have no right to stop this robot.")


def test_settings_and_objects_are_changed_by_those_who_may(pages: Pages, guarded: AuthenticatedGateway) -> None:
    """The title of a robot, objects of the world, and placements."""
    with guarded.browsing("root") as root:
        title = str(root.robot(SEEN).property(LF.TextProperty))
        world = str(root.page(root.root).one(LF.world))
        objects = str(root.page(world).one(LF.objects))
        crate = root.http.post(objects, content=CRATE, headers=TURTLE)
        assert crate.status_code == 201, crate.text
    checks: list[tuple[str, Callable[[Locator], None]]] = [("mover", not_changed), ("keeper", enabled)]
    for reader, check in checks:
        page = pages.open(reader, title)
        check(page.locator(SEND))
        page.goto(objects)
        check(page.locator(SEND))
        check(page.locator("button[data-delete]").first)
        page.goto(crate.headers["location"])
        check(page.locator(SEND))
        check(page.locator("button[data-delete]"))
        page.goto(world)
        check(opened(page, "Place it: its position is unknown"))
        check(page.locator("[data-things] button[data-delete]").first)


CRATE = """@prefix lf: <https://w3id.org/linked-fleet#> . @prefix dcterms: <http://purl.org/dc/terms/> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
<> a lf:Obstacle ; dcterms:title "crate" ; lf:position [ maths:x 9 ; maths:y 9 ; maths:z 1 ; vom:unit unit:M ] ;
    lf:geometry [ a lf:Box ; lf:size [ maths:x 1 ; maths:y 1 ; maths:z 1 ; vom:unit unit:M ] ] ."""
RULE = """@prefix lf: <https://w3id.org/linked-fleet#> . @prefix dcterms: <http://purl.org/dc/terms/> .
<> dcterms:title "Nothing" ; lf:invokes <STOP> ;
    lf:condition "PREFIX lf: <https://w3id.org/linked-fleet#> SELECT ?robot WHERE { ?robot a lf:Nothing }" ."""


def test_rules_are_made_by_those_who_may(pages: Pages, guarded: AuthenticatedGateway) -> None:
    with guarded.browsing("root") as root:
        rules = str(root.page(root.root).one(LF.rules))
        body = RULE.replace("STOP", of_robot(root, LF.StopRobot, robot=SEEN))
        rule = root.http.post(rules, content=body, headers=TURTLE)
        assert rule.status_code == 201, rule.text
    page = pages.open("looker", rules)
    closed(page.locator("button[data-save]"), FOLLOWS)
    closed(page.get_by_role("switch"), FOLLOWS)
    expect(page.locator("button[data-try]")).to_be_enabled()
    page.goto(rule.headers["location"])
    closed(page.locator("button[data-delete]"), FOLLOWS)
    page = pages.open("root", rules)
    expect(page.locator("button[data-save]")).to_be_enabled()
    expect(page.get_by_role("switch")).to_be_enabled()


@pytest.fixture
def held(client: Client) -> Iterator[httpx.Response]:
    """Have somebody else control the robot."""
    lease = str(client.robot("ur5").one(LF.lease))
    taken = client.http.put(lease, content=control("Ada", 600), headers=TURTLE)
    assert taken.is_success, taken.text
    yield taken
    client.http.delete(lease, headers={"lock-token": taken.headers["lock-token"]})


def test_what_the_holder_of_control_alone_may_do(
    page: Page, watched: object, client: Client, held: httpx.Response
) -> None:
    """Motions and settings are disabled on all pages, what stops is not; all is enabled when control is given back."""
    robot = client.robot("ur5")
    page.goto(of_robot(client, LF.StopRobot))
    expect(page.locator(SEND)).to_be_enabled()
    page.goto(str(robot.property(LF.TextProperty)))
    closed(page.locator(SEND), HELD)
    page.goto(str(client.page(client.root).one(LF.world)))
    closed(opened(page, "Place it: its position is unknown"), HELD)
    page.goto(robot.url)
    closed(page.locator("form.motion button[data-send]"), HELD)
    page.goto(client.part("ur5", WRIST).url)
    closed(opened(page, "rotate"), HELD)
    page.goto(of_joint(client, WRIST))
    send = page.locator(SEND)
    closed(send, HELD)
    released = client.http.delete(str(robot.one(LF.lease)), headers={"lock-token": held.headers["lock-token"]})
    assert released.is_success, released.text
    expect(send).to_be_enabled()
    expect(page.locator("form.invoke p.closed")).to_have_count(0)


def test_control_is_taken_and_given_back_on_its_own_page(page: Page, watched: object, client: Client) -> None:
    lease = str(client.robot("ur5").one(LF.lease))
    page.goto(lease)
    panel = page.locator("#control")
    expect(panel.locator(".holder")).to_have_text("Nobody has it.")
    panel.get_by_role("button", name="Take control").click()
    expect(panel.locator(".holder")).to_have_text("You have control.")
    assert client.page(lease).one(LF.holder)
    panel.get_by_role("button", name="Give back").click()
    expect(panel.locator(".holder")).to_have_text("Nobody has it.")


def test_to_keep_and_to_delete_are_told_apart(page: Page, watched: object, client: Client) -> None:
    """By their distance and their colour."""
    objects = str(client.page(str(client.page(client.root).one(LF.world))).one(LF.objects))
    crate = client.http.post(objects, content=CRATE, headers=TURTLE)
    page.goto(crate.headers["location"])
    page.get_by_role("button", name="Delete crate").click()
    keep, delete = (page.get_by_role("dialog").get_by_role("button", name=name) for name in ("Keep it", "Delete"))
    one, other = keep.bounding_box(), delete.bounding_box()
    assert one is not None and other is not None
    assert other["x"] - (one["x"] + one["width"]) >= 8
    colour = "(each) => getComputedStyle(each).color"
    assert keep.evaluate(colour) != delete.evaluate(colour)
    keep.click()
    assert client.http.get(crate.headers["location"]).status_code == 200
    page.get_by_role("button", name="Delete crate").click()
    delete.click()
    expect(page).to_have_url(objects)
    assert client.http.get(crate.headers["location"]).status_code == 404


def test_a_page_asks_no_more_for_what_it_has_deleted(page: Page, watched: object, client: Client) -> None:
    """Its subscription ends before the response to the DELETE comes, which may take a while."""
    objects = str(client.page(str(client.page(client.root).one(LF.world))).one(LF.objects))
    crate = client.http.post(objects, content=CRATE, headers=TURTLE).headers["location"]
    page.clock.install()
    with page.expect_websocket(lambda socket: crate.partition(":")[2] in socket.url) as socket:
        page.goto(crate)
    socket.value.wait_for_event("framereceived")

    def answer_late(route: Route) -> None:
        if route.request.method == "DELETE":
            late = route.fetch()
            page.clock.run_for(3000)
            route.fulfill(response=late)
        else:
            route.continue_()

    page.route(crate, answer_late)
    page.get_by_role("button", name="Delete crate").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    expect(page).to_have_url(objects)


def logged_in(context: BrowserContext, guarded: AuthenticatedGateway, name: str, path: str) -> Page:
    page = context.new_page()
    page.goto(guarded.root + path)
    log_in(page, guarded.tokens[name])
    expect(page.locator("#who")).to_have_text(name)
    return page


def test_control_goes_from_hand_to_hand(chromium: Browser, guarded: AuthenticatedGateway) -> None:
    """One asks, the other hands over, and the first has control with the token that its browser has made."""
    with chromium.new_context() as first, chromium.new_context() as second:
        has, asks = (logged_in(each, guarded, name, f"{SEEN}/") for each, name in ((first, "root"), (second, "mover")))
        has.get_by_role("button", name="Take control").click()
        expect(has.locator("#control .holder")).to_have_text("You have control.")
        asks.get_by_role("button", name="Ask for control").click()
        expect(asks.locator("#control .asking")).to_contain_text("You have asked root for control.")
        expect(has.locator("#control .asking")).to_contain_text("mover asks for control.")
        has.get_by_role("button", name="Hand over").click()
        expect(asks.locator("#control .holder")).to_have_text("You have control.")
        expect(has.locator("#control .holder")).to_contain_text("mover")
        asks.get_by_role("button", name="Give back").click()
        expect(asks.locator("#control .holder")).to_have_text("Nobody has it.")


def test_a_guest_sees_why_controls_are_closed(chromium: Browser, guarded: AuthenticatedGateway) -> None:
    """Also without scripts. The link is shown to its author, and is not in the address afterwards."""
    with chromium.new_context() as hosts, chromium.new_context(java_script_enabled=False) as guests:
        host = logged_in(hosts, guarded, "root", "invitations")
        host.get_by_label("Whom it is for").fill("a visitor")
        host.get_by_role("button", name="Make a link").click()
        link = host.get_by_label("Send this link").input_value()
        expect(host.locator("#invitations")).to_contain_text("a visitor")
        guest = guests.new_page()
        guest.goto(link)
        assert guest.url == guarded.root
        guest.goto(f"{guarded.root}{SEEN}/actions/moveJoints")
        expect(guest.locator(SEND)).to_be_disabled()
        expect(guest.locator(SEND)).to_have_accessible_description(MOVES)
        expect(guest.locator("form.invoke p.closed")).to_have_text(MOVES)
        host.get_by_role("button", name="Revoke the invitation for a visitor").click()
        host.get_by_role("dialog").get_by_role("button", name="Revoke").click()
        expect(host.locator("#invitations")).to_contain_text("Nobody is invited.")
        guest.goto(guarded.root)
        expect(guest.get_by_label("Token", exact=True)).to_be_visible()
