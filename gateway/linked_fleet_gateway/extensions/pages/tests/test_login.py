"""Logging in on a page, by a token or at an issuer, with and without scripts, and logging out."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from accessibility import violations_in_both_schemes
from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import LF
from issuer import Issuer, issuing
from page_user import PageUser, log_in
from running import eventually
from subscribers import members

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
REFUSED = "Failed to load resource"


@pytest.fixture(scope="module")
def issuer() -> Iterator[Issuer]:
    with issuing() as one:
        yield one


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory, issuer: Issuer) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded"), issuer=issuer) as one:
        one.add("lab", *ALL, robots=("lab-*",))
        one.known("lab")
        yield one


@pytest.mark.task("Log in, and see what one may do", presses=1)
def test_a_token_opens_what_it_is_for(operator: PageUser, own: AuthenticatedGateway) -> None:
    """The requested page follows the login with one click; it is live, and can stop a robot."""
    page = operator.page
    page.goto(f"{own.root}{SEEN}/")
    expect(page).to_have_url(re.compile("/login"))
    assert violations_in_both_schemes(page) == []
    page.get_by_role("link", name="Deutsch").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Anmelden")
    page.get_by_role("link", name="English").click()
    page.get_by_label("Token", exact=True).fill(own.tokens["lab"])
    operator.press(page.get_by_role("button", name="Log in"))
    expect(page).to_have_url(f"{own.root}{SEEN}/")
    expect(page.locator("#who")).to_have_text("lab")
    operator.finish()
    assert operator.fits()
    with own.browsing("root") as root:
        invocations = str(root.page(root.action(root.robot(SEEN), LF.StopRobot)).one(LF.invocations))
        before = set(members(root.page(invocations)))
        page.get_by_role("button", name=f"Stop {SEEN}").click()
        eventually(lambda: set(members(root.page(invocations))) - before, "the robot stopped")
    page.goto(own.root)
    expect(page.get_by_role("link", name=f"The {SEEN}").or_(page.get_by_text(SEEN)).first).to_be_visible()
    assert HIDDEN not in page.content()
    page.goto(own.root + "login")
    assert violations_in_both_schemes(page) == [] and operator.fits()


def test_a_page_of_a_session_is_live(page: Page, watched: object, own: AuthenticatedGateway) -> None:
    """Its WebSocket or event stream accepts the cookie."""
    page.goto(f"{own.root}{SEEN}/")
    log_in(page, own.tokens["lab"])
    expect(page).to_have_url(f"{own.root}{SEEN}/")
    page.evaluate("window.marked = true")
    with own.browsing("root") as root:
        title = str(root.robot(SEEN).property(LF.TextProperty))
        body = f'<> <{LF}value> "Renamed" .'
        put = root.http.put(title, content=body, headers={"content-type": "text/turtle"})
        assert put.status_code == 204, put.text
    expect(page.get_by_text("Renamed").first).to_be_visible()
    assert page.evaluate("window.marked") is True


def test_every_page_says_what_one_may_do(page: Page, watched: object, own: AuthenticatedGateway) -> None:
    """Other pages show the rights over their resource, the account page shows all."""
    page.goto(f"{own.root}{SEEN}/")
    log_in(page, own.tokens["lab"])
    page.locator(".reader summary").click()
    expect(page.locator(".reader div")).to_contain_text(
        "Here you may look, follow changes, stop, act, reset stops and administer."
    )
    page.get_by_role("link", name="Your account").click()
    expect(page.get_by_role("row", name="act")).to_contain_text("lab-*")
    expect(page.get_by_role("navigation", name="Sections").get_by_role("link", name="Audit")).to_have_count(0)


def test_one_logs_out(page: Page, watched: object, own: AuthenticatedGateway) -> None:
    page.goto(own.root)
    log_in(page, own.tokens["lab"])
    page.get_by_role("button", name="Log out").click()
    expect(page).to_have_url(own.root + "login")
    page.goto(own.root)
    expect(page).to_have_url(re.compile("/login"))


def test_a_wrong_token_says_so(page: Page, watched: object, own: AuthenticatedGateway) -> None:
    page.goto(own.root + "login")
    page.get_by_label("Token", exact=True).fill("wrong")
    page.get_by_role("button", name="Log in").click()
    field = page.get_by_label("Token", exact=True)
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(field).to_have_accessible_description("This token is not accepted: it is unknown.")
    expect(field).to_be_focused()
    assert violations_in_both_schemes(page) == []
    watched.forgive(REFUSED)  # type: ignore[attr-defined]


def test_without_scripts(chromium: Browser, own: AuthenticatedGateway) -> None:
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(f"{own.root}{SEEN}/")
    log_in(page, own.tokens["lab"])
    expect(page).to_have_url(f"{own.root}{SEEN}/")
    page.get_by_role("button", name="Log out").click()
    expect(page).to_have_url(own.root + "login")
    context.close()


def test_an_issuer_says_who_one_is(page: Page, own: AuthenticatedGateway, issuer: Issuer) -> None:
    page.goto(f"{own.root}{SEEN}/")
    page.get_by_role("link", name="Log in at plant").click()
    expect(page).to_have_url(f"{own.root}{SEEN}/")
    expect(page.locator("#who")).to_have_text("ada@plant")
    names = {cookie["name"] for cookie in page.context.cookies()}
    assert names == {"linked-fleet"}  # that of the pending login is gone


def test_a_login_without_rights_sees_no_robots(page: Page, own: AuthenticatedGateway, issuer: Issuer) -> None:
    issuer.subject, issuer.claims = "eve", {"groups": ["visitors"]}
    try:
        page.goto(f"{own.root}{SEEN}/")
        page.get_by_role("link", name="Log in at plant").click()
        expect(page.get_by_role("heading", name="There is no such resource")).to_be_visible()
    finally:
        issuer.subject, issuer.claims = "ada", {"groups": ["operators"]}


def test_a_login_of_another_browser_is_not_taken_over(
    page: Page, chromium: Browser, own: AuthenticatedGateway, issuer: Issuer
) -> None:
    """Login CSRF: the address to which an issuer redirects one browser is worthless in another."""
    returned: list[str] = []
    page.on("request", lambda request: returned.append(request.url))
    page.goto(own.root + "login")
    page.get_by_role("link", name="Log in at plant").click()
    expect(page).to_have_url(own.root)
    (back,) = [url for url in returned if "/login/return" in url]
    context = chromium.new_context()
    other = context.new_page()
    answer = other.goto(back)
    assert answer is not None and answer.status == 401 and not context.cookies()
    context.close()


def test_a_page_whose_session_is_over_leads_to_the_login(page: Page, own: AuthenticatedGateway) -> None:
    own.add("passing", "read", "subscribe")
    own.known("passing")
    page.goto(f"{own.root}{SEEN}/")
    log_in(page, own.tokens["passing"])
    expect(page).to_have_url(f"{own.root}{SEEN}/")
    own.revoke("passing")
    expect(page).to_have_url(re.compile("/login"))


def test_a_page_without_the_right_to_subscribe_says_that_it_is_not_live(page: Page, own: AuthenticatedGateway) -> None:
    own.add("reader", "read")
    own.known("reader")
    page.goto(f"{own.root}{SEEN}/")
    log_in(page, own.tokens["reader"])
    expect(page.locator("#connection")).to_contain_text("You have no right to watch")
    expect(page.locator("#who")).to_have_text("reader")
