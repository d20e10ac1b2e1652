"""Sessions of browsers: what their cookie permits, and that pages of other origins cannot use it."""

from collections.abc import Iterator
from urllib.parse import urlsplit

import httpx
import pytest

from authenticated_gateway import SEEN, AuthenticatedGateway
from browser import LF
from running import eventually
from subscribers import Socket, refused

pytestmark = pytest.mark.virtual
_HTML = "text/html,application/xhtml+xml,*/*;q=0.8"


@pytest.fixture
def http(here: AuthenticatedGateway) -> Iterator[httpx.Client]:
    """Yield a client like a browser with a session of ``all``, without further headers."""
    with httpx.Client(timeout=20) as client:
        answer = log_in(here, client, here.tokens["all"])
        assert answer.status_code == 303 and answer.headers["location"] == here.root
        yield client


def log_in(here: AuthenticatedGateway, client: httpx.Client, token: str, then: str = "/") -> httpx.Response:
    return client.post(here.root + "login", data={"token": token, "then": then}, headers={"origin": here.root[:-1]})


def _stop_all(here: AuthenticatedGateway) -> str:
    with here.browsing("root") as browser:
        return browser.action(browser.page(browser.root), LF.StopAll)


def test_people_are_sent_to_the_login_and_back(here: AuthenticatedGateway) -> None:
    with httpx.Client() as client:
        sent = client.get(here.root + f"{SEEN}/?as=turtle", headers={"accept": _HTML})
        assert sent.status_code == 303
        page = client.get(sent.headers["location"], headers={"accept": _HTML})
        assert page.status_code == 200 and 'name="then" value="/lab-1/?as=turtle"' in page.text
        back = log_in(here, client, here.tokens["all"], "/lab-1/?as=turtle")
        assert back.headers["location"] == f"{here.root}lab-1/?as=turtle"
        assert client.get(back.headers["location"], headers={"accept": _HTML}).status_code == 200


def test_the_cookie_is_for_the_browser_alone(here: AuthenticatedGateway) -> None:
    with httpx.Client() as client:
        said = log_in(here, client, here.tokens["all"]).headers["set-cookie"]
    assert said.startswith("linked-fleet=") and here.tokens["all"] not in said
    assert {"HttpOnly", "Path=/", "SameSite=lax"} <= set(said.split("; "))


def test_a_session_reads(here: AuthenticatedGateway, http: httpx.Client) -> None:
    page = http.get(here.root, headers={"accept": _HTML})
    assert page.status_code == 200 and SEEN in page.text
    assert page.headers["cache-control"] == "private, no-cache"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 403),
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
        ({"sec-fetch-site": "same-origin"}, 204),
        ({"origin": "OURS"}, 204),
    ],
)
def test_a_session_acts_for_our_pages_alone(
    here: AuthenticatedGateway, http: httpx.Client, headers: dict[str, str], status: int
) -> None:
    said = {name: value.replace("OURS", here.root[:-1]) for name, value in headers.items()}
    assert http.post(_stop_all(here), headers=said).status_code == status


def test_a_session_listens_for_our_pages_alone(here: AuthenticatedGateway, http: httpx.Client) -> None:
    cookie, ours = f"linked-fleet={http.cookies['linked-fleet']}", here.root[:-1]
    for origin in ({}, {"Origin": "https://evil.example"}, {"Origin": "null"}):
        assert refused(here.root, Cookie=cookie, **origin).status_code == 403
    with Socket(here.root, Cookie=cookie, Origin=ours) as open_:
        assert SEEN in open_.raw()
    events = {"accept": "text/event-stream"}
    for headers, status in (
        ({}, 403),
        ({"accept": "Text/Event-Stream"}, 403),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"sec-fetch-site": "same-origin"}, 200),
    ):
        with http.stream("GET", here.root, headers=events | headers) as response:
            assert response.status_code == status
    callback = {"connection": "upgrade", "upgrade": "callback", "callback": "http://127.0.0.1:9/"}
    assert http.get(here.root, headers=callback).status_code == 403


def test_an_event_source_is_not_sent_to_the_login(here: AuthenticatedGateway) -> None:
    for accept, status in ((_HTML, 303), (f"text/event-stream, {_HTML}", 401), (f"Text/Event-Stream, {_HTML}", 401)):
        assert httpx.get(here.root, headers={"accept": accept}).status_code == status


def test_a_foreign_page_cannot_open_a_websocket(here: AuthenticatedGateway) -> None:
    bearer = f"Bearer {here.tokens['all']}"
    assert refused(here.root, Authorization=bearer, Origin="https://evil.example").status_code == 403


def test_one_logs_out_and_the_session_is_over(here: AuthenticatedGateway, http: httpx.Client) -> None:
    assert http.post(here.root + "logout").status_code == 403  # from a page of another origin
    out = http.post(here.root + "logout", headers={"origin": here.root[:-1]})
    assert out.status_code == 303 and "Max-Age=0" in out.headers["set-cookie"]
    assert http.get(here.root, headers={"accept": "text/turtle"}).status_code == 401


def test_a_copied_cookie_is_worth_nothing_once_its_owner_has_logged_out(
    here: AuthenticatedGateway, http: httpx.Client
) -> None:
    """Streams of that session end; other sessions with the same token continue."""
    copy, ours = f"linked-fleet={http.cookies['linked-fleet']}", {"origin": here.root[:-1]}
    with httpx.Client() as tablet, Socket(here.root, Cookie=copy, Origin=here.root[:-1]) as open_:
        log_in(here, tablet, here.tokens["all"])
        open_.raw()
        assert http.post(here.root + "logout", headers=ours).status_code == 303
        assert open_.until_closed()[0] == 1008
        for method, headers in (("GET", {}), ("POST", ours)):
            answer = httpx.request(method, _stop_all(here), headers={"cookie": copy} | headers)
            assert answer.status_code == 401 and "invalid_token" in answer.headers["www-authenticate"]
        assert refused(here.root, Cookie=copy, Origin=here.root[:-1]).status_code == 401
        assert (
            httpx.post(here.root + "logout", headers={"cookie": copy} | ours).status_code == 303
        )  # any number of times
        assert tablet.get(here.root).status_code == 200


def test_a_session_lives_no_longer_than_its_token(here: AuthenticatedGateway) -> None:
    here.add("passing", "read")
    here.known("passing")
    with httpx.Client() as client:
        log_in(here, client, here.tokens["passing"])
        assert client.get(here.root).status_code == 200
        here.revoke("passing")
        assert eventually(lambda: client.get(here.root).status_code == 401, "the session over")


def test_the_numbers_are_for_programs_with_a_token(here: AuthenticatedGateway, http: httpx.Client) -> None:
    assert http.get(here.root + "metrics").status_code == 401
    assert http.get(here.root + "metrics", headers={"authorization": f"Bearer {here.tokens['all']}"}).status_code == 200
    assert here.gateway is not None and "Traceback" not in here.gateway.output


@pytest.mark.parametrize("value", ["", "x", "a.b.c", "eyJhbGciOiJub25lIn0.eyJ0b2tlbiI6IjAwIiwiYXVkIjoic2Vzc2lvbiJ9."])
def test_a_cookie_of_ones_own_making_is_none(here: AuthenticatedGateway, value: str) -> None:
    answer = httpx.get(here.root, headers={"cookie": f"linked-fleet={value}"})
    assert answer.status_code == 401


@pytest.mark.parametrize("then", ["//evil.example/", "https://evil.example/", "/\\evil.example", "x", "/a\r\nX: y"])
def test_the_login_leads_to_us_and_nowhere_else(here: AuthenticatedGateway, then: str) -> None:
    with httpx.Client() as client:
        there = log_in(here, client, here.tokens["all"], then).headers["location"]
    assert urlsplit(there).netloc == urlsplit(here.root).netloc and "X:" not in there.partition("/a")[1]


def test_nobody_is_logged_in_by_a_foreign_page(here: AuthenticatedGateway) -> None:
    for headers in ({}, {"origin": "https://evil.example"}, {"sec-fetch-site": "cross-site"}):
        form = {"token": here.tokens["all"]}
        assert httpx.post(here.root + "login", data=form, headers=headers).status_code == 403


@pytest.mark.parametrize("path", ["login", "login/start", "login/return", "logout"])
def test_the_pages_have_their_methods_and_no_others(here: AuthenticatedGateway, path: str) -> None:
    answer = httpx.request("DELETE", here.root + path)
    assert answer.status_code == 405 and answer.headers["allow"]


def test_a_return_without_a_beginning_is_refused(here: AuthenticatedGateway) -> None:
    answer = httpx.get(here.root + "login/return?code=x&state=y", headers={"accept": _HTML})
    assert answer.status_code == 401 and "set-cookie" not in answer.headers
    assert httpx.get(here.root + "login/start?issuer=none").status_code == 404


def test_guessing_is_slowed_down(here: AuthenticatedGateway) -> None:
    """After ten failures a wrong token gets 429; requests with a valid one are answered."""
    with httpx.Client() as client:
        answers = [log_in(here, client, f"guess{n}") for n in range(12)]
        statuses = [each.status_code for each in answers]
        assert statuses[0] == 401 and statuses[-1] == 429
        assert int(answers[-1].headers["retry-after"]) > 0
        assert client.get(here.root, headers={"authorization": f"Bearer {here.tokens['all']}"}).status_code == 200


def test_a_login_cannot_be_rehearsed(here: AuthenticatedGateway) -> None:
    form = {"token": here.tokens["all"], "then": "/"}
    for fields in ({"prefer": "dry-run"}, {"if-match": '"1"'}, {"idempotency-key": "1"}):
        answer = httpx.post(here.root + "login", data=form, headers={"origin": here.root[:-1], **fields})
        assert answer.status_code in (400, 412) and "set-cookie" not in answer.headers
