"""Pages of other origins: those allowed to use the fleet, with a token of their own, and all others."""

from collections.abc import Iterator

import httpx
import pytest

from authenticated_gateway import ALL, AuthenticatedGateway, run_authenticated
from browser import LF

pytestmark = pytest.mark.virtual
TWIN = "https://twin.example:8443"
STRANGER = "https://twin.example"


@pytest.fixture(scope="module")
def open_to(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("cors"), "--cors-origins", TWIN, robots=False) as one:
        one.add("all", *ALL)
        one.known("all")
        yield one


def _stop_all(here: AuthenticatedGateway) -> str:
    with here.browsing("root") as browser:
        return browser.action(browser.page(browser.root), LF.StopAll)


def _problem(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["type"].rpartition("#")[2]


def test_a_session_is_not_for_them(open_to: AuthenticatedGateway) -> None:
    """A user with a session here who visits such a page has not requested anything."""
    stop, ours = _stop_all(open_to), {"origin": open_to.root[:-1]}
    with httpx.Client(timeout=20) as client:
        logged_in = client.post(open_to.root + "login", data={"token": open_to.tokens["all"]}, headers=ours)
        assert logged_in.status_code == 303
        assert client.post(stop, headers=ours).status_code == 204
        assert _problem(client.post(stop, headers={"origin": TWIN})) == (403, "foreign-origin")
        answer = client.get(open_to.root, headers={"origin": TWIN})
        assert answer.headers["access-control-allow-origin"] == TWIN
        assert "access-control-allow-credentials" not in answer.headers


def test_their_token_is(open_to: AuthenticatedGateway) -> None:
    bearer = {"authorization": f"Bearer {open_to.tokens['all']}", "origin": TWIN}
    done = httpx.post(_stop_all(open_to), headers=bearer)
    assert (done.status_code, done.headers["access-control-allow-origin"]) == (204, TWIN)
    assert "Origin" in done.headers["vary"]


def test_pages_of_other_origins_have_no_session(open_to: AuthenticatedGateway) -> None:
    answer = httpx.post(open_to.root + "login", data={"token": open_to.tokens["all"]}, headers={"origin": TWIN})
    assert answer.status_code == 403 and "set-cookie" not in answer.headers


def test_others_hear_nothing(open_to: AuthenticatedGateway) -> None:
    asked = {"origin": STRANGER, "access-control-request-method": "POST", "access-control-request-headers": "prefer"}
    assert "access-control-allow-origin" not in httpx.options(open_to.root, headers=asked).headers
    bearer = {"authorization": f"Bearer {open_to.tokens['all']}", "origin": STRANGER}
    assert "access-control-allow-origin" not in httpx.get(open_to.root, headers=bearer).headers
    assert _problem(httpx.post(_stop_all(open_to), headers=bearer)) == (403, "foreign-origin")


def test_without_the_setting_there_are_none(here: AuthenticatedGateway) -> None:
    bearer = {"authorization": f"Bearer {here.tokens['all']}", "origin": TWIN}
    assert "access-control-allow-origin" not in httpx.get(here.root, headers=bearer).headers
    asked = {"origin": TWIN, "access-control-request-method": "POST"}
    assert "access-control-allow-origin" not in httpx.options(here.root, headers=asked).headers
