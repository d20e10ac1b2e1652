"""Control goes from who has it to who asks for it, and to nobody else."""

import time
import uuid
from collections.abc import Iterator

import httpx
import pytest

from authenticated_gateway import HIDDEN, SEEN, AuthenticatedGateway
from browser import LF, Browser
from linked_fleet_gateway.extensions.people import asking
from linked_fleet_gateway.extensions.people.control_request import ControlRequest
from running import eventually

pytestmark = pytest.mark.virtual
_TURTLE = {"content-type": "text/turtle"}
_PREFIX = "@prefix lf: <https://w3id.org/linked-fleet#> . "


def lease_of(browser: Browser, robot: str = SEEN) -> str:
    return f"{browser.root}{robot}/lease"


def take(browser: Browser, token: str = "", robot: str = SEEN) -> httpx.Response:
    headers = _TURTLE | ({"lock-token": token} if token else {})
    said = f'{_PREFIX} [] lf:holder "somebody" ; lf:leaseDuration 30 .'
    return browser.http.put(lease_of(browser, robot), content=said, headers=headers)


def ask(browser: Browser, token: str = "", robot: str = SEEN) -> httpx.Response:
    """Ask for control with a new token, or with this one."""
    token = token or f"urn:uuid:{uuid.uuid4()}"
    said = f'{_PREFIX} [] lf:ofRobot <{browser.root}{robot}/> ; lf:controlToken "{token}" .'
    return browser.http.post(browser.root + "control-requests", content=said, headers=_TURTLE)


def holder(browser: Browser) -> str:
    return str(browser.page(lease_of(browser)).one(LF.holder))


@pytest.fixture
def controlling(here: AuthenticatedGateway) -> Iterator[tuple[Browser, str]]:
    """Yield who has control of the seen robot, and its token. Afterwards nobody has control."""
    with here.browsing("all") as browser:
        token = take(browser).headers["lock-token"]
        yield browser, token
        for each in browser.page(browser.root + "control-requests").graph.subjects(None, LF.ControlRequest):
            browser.http.delete(str(each))
        browser.http.delete(lease_of(browser), headers={"lock-token": token})


def test_control_is_handed_over(here: AuthenticatedGateway, controlling: tuple[Browser, str]) -> None:
    """The new holder has control by its own token at once, and the old one has none."""
    has, token = controlling
    with here.browsing("actor") as asks:
        mine = f"urn:uuid:{uuid.uuid4()}"
        request = ask(asks, mine)
        assert request.status_code == 201, request.text
        assert mine not in request.text and mine not in asks.http.get(asks.root + "control-requests").text
        url = request.headers["location"]
        assert take(asks, f"<{mine}>").status_code == 409  # it was not granted so far
        assert asks.http.post(url + "/actions/handOver").status_code == 409
        assert asks.http.post(url + "/actions/handOver", headers={"lock-token": f"<{mine}>"}).status_code == 409
        granted = has.http.post(url + "/actions/handOver", headers={"lock-token": token})
        assert granted.is_success, granted.text
        assert holder(asks) == "actor" and LF.controlGranted in asks.page(url).graph.objects(None, LF.state)
        assert take(has, token).status_code == 409
        assert take(asks, f"<{mine}>").status_code == 204
        again = has.http.post(url + "/actions/handOver", headers={"lock-token": token})
        assert again.status_code == 409 and "answered already" in again.text
        assert asks.http.delete(lease_of(asks), headers={"lock-token": f"<{mine}>"}).status_code == 204


def test_nobody_puts_a_request_of_its_own_in_the_place_of_another(
    here: AuthenticatedGateway, controlling: tuple[Browser, str]
) -> None:
    """Its holder would hand over control to somebody else than the one whose name the page shows."""
    here.add("mallory", "read", "act")
    here.known("mallory")
    with here.browsing("actor") as asks, here.browsing("mallory") as other:
        url = ask(asks).headers["location"]
        said = f'{_PREFIX} [] lf:ofRobot <{other.root}{SEEN}/> ; lf:controlToken "urn:uuid:{uuid.uuid4()}" .'
        assert other.http.put(url, content=said, headers=_TURTLE).status_code == 403
        assert other.http.delete(url).status_code == 403
        assert asks.http.delete(url).status_code == 204


def test_control_is_refused(here: AuthenticatedGateway, controlling: tuple[Browser, str]) -> None:
    has, token = controlling
    with here.browsing("actor") as asks:
        url = ask(asks).headers["location"]
        assert has.http.post(url + "/actions/refuse", headers={"lock-token": token}).is_success
        assert LF.controlRefused in asks.page(url).graph.objects(None, LF.state)
        assert holder(asks) == "somebody"


def test_everybody_asks_once(here: AuthenticatedGateway, controlling: tuple[Browser, str]) -> None:
    with here.browsing("actor") as asks:
        url = ask(asks).headers["location"]
        second = ask(asks)
        assert second.status_code == 409 and "You have asked for control of lab-1 already" in second.text
        assert asks.http.delete(url).status_code == 204
        assert ask(asks).status_code == 201


def test_nobody_can_be_asked_for_what_nobody_has(here: AuthenticatedGateway) -> None:
    with here.browsing("actor") as asks:
        answer = ask(asks)
        assert answer.status_code == 409 and "Nobody has control of this robot" in answer.text


@pytest.mark.parametrize("name", ["reader", "stopper", "subscriber", "admin"])
def test_asking_takes_the_right_to_act(here: AuthenticatedGateway, controlling: tuple[Browser, str], name: str) -> None:
    with here.browsing(name) as asks:
        assert ask(asks).status_code == 403


def test_hidden_robots_stay_hidden(here: AuthenticatedGateway) -> None:
    with here.browsing("all") as has, here.browsing("actor") as asks, here.browsing("lab") as lab:
        token = take(has, robot=HIDDEN).headers["lock-token"]
        url = ask(asks, robot=HIDDEN).headers["location"]
        assert lab.http.get(url).status_code == 404
        assert HIDDEN not in lab.http.get(lab.root + "control-requests").text
        answer = ask(lab, robot=HIDDEN)
        assert answer.status_code == 422 and "There is no robot at" in answer.text
        assert HIDDEN not in lab.http.get(lab.root + "people").text
        asks.http.delete(url)
        assert has.http.delete(lease_of(has, HIDDEN), headers={"lock-token": token}).status_code == 204


@pytest.mark.parametrize("token", ["x", "urn:uuid:1", "urn:uuid:" + "g" * 36, "kept:" + "0" * 36])
def test_a_token_is_a_uuid(here: AuthenticatedGateway, controlling: tuple[Browser, str], token: str) -> None:
    with here.browsing("actor") as asks:
        answer = ask(asks, token)
        assert answer.status_code == 422 and "controlToken is a random UUID" in answer.text


def test_people_who_act_see_who_has_control(here: AuthenticatedGateway, controlling: tuple[Browser, str]) -> None:
    with here.browsing("actor") as actor, here.browsing("reader") as reader:
        page = actor.http.get(actor.root + "people", headers={"accept": "text/html"})
        assert page.status_code == 200 and "somebody" in page.text and SEEN in page.text
        assert reader.http.get(reader.root + "people").status_code == 403


def test_people_are_here_while_they_use_a_session(here: AuthenticatedGateway) -> None:
    with here.browsing("actor") as actor, httpx.Client(timeout=20) as client:
        form = {"token": here.tokens["stopper"], "then": "/"}
        client.post(here.root + "login", data=form, headers={"origin": here.root[:-1]})

        def is_here() -> bool:
            client.get(here.root)
            return "stopper" in actor.http.get(actor.root + "people").text

        assert eventually(is_here, "the reader of a page here")


async def test_requests_end() -> None:
    now_ns = time.time_ns()

    class Records:
        def __init__(self) -> None:
            ends = {"old": now_ns - 1, "new": now_ns * 2}
            self.known = {name: ControlRequest("r", "t", ends_ns=ends_ns) for name, ends_ns in ends.items()}

        async def change(self, id: str, record: object) -> bool:
            return self.known.pop(id) is not record

    records = Records()
    await asking.forget_ended(records)  # type: ignore[arg-type]
    assert records.known.keys() == {"new"}
