"""Invitations: what guests may do, and until when."""

import time
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import partial

import httpx
import pytest
import rdflib
from rdflib import DCTERMS, URIRef

from authenticated_gateway import HIDDEN, SEEN, AuthenticatedGateway
from browser import LF
from linked_fleet_gateway.extensions.sessions import invitations as module
from linked_fleet_gateway.extensions.sessions.login import FAILURES
from running import eventually
from subscribers import Socket

pytestmark = pytest.mark.virtual
_HTML = {"accept": "text/html"}
_BODY = (
    "@prefix lf: <https://w3id.org/linked-fleet#> . @prefix dcterms: <http://purl.org/dc/terms/> ."
    ' [] dcterms:title "the visitors" ; lf:expires "{}"^^<http://www.w3.org/2001/XMLSchema#dateTime> .'
)


def invited(here: AuthenticatedGateway, by: str = "all", hours: float = 1, status: int = 201) -> tuple[str, str]:
    """Return the address of a new invitation, and its link."""
    until = datetime.fromtimestamp(time.time() + hours * 3600, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    with here.browsing(by) as browser:
        headers = {"content-type": "text/turtle", "accept": "text/turtle"}
        answer = browser.http.post(here.root + "invitations", content=_BODY.format(until), headers=headers)
        assert answer.status_code == status, answer.text
        if status != 201:
            return "", answer.text
        assert answer.headers["cache-control"] == "no-store"
        location = answer.headers["location"]
        graph = rdflib.Graph().parse(data=answer.text, publicID=location)
        return location, str(graph.value(URIRef(location), LF.invitationLink))


@pytest.fixture
def guest(here: AuthenticatedGateway) -> Iterator[httpx.Client]:
    """Yield the browser of somebody who has opened a link."""
    _, link = invited(here)
    with httpx.Client(timeout=20) as client:
        answer = client.get(link, headers=_HTML)
        assert (answer.status_code, answer.headers["location"]) == (303, here.root)
        assert answer.headers["referrer-policy"] == "no-referrer" and answer.headers["cache-control"] == "no-store"
        assert "HttpOnly" in answer.headers["set-cookie"] and link.partition("=")[2] not in answer.headers["set-cookie"]
        yield client


def test_a_guest_sees_the_fleet_under_the_name_of_the_host(here: AuthenticatedGateway, guest: httpx.Client) -> None:
    page = guest.get(here.root, headers=_HTML)
    assert page.status_code == 200 and SEEN in page.text and HIDDEN in page.text and "guest of all" in page.text
    with here.browsing("all") as browser:
        found = partial(browser.http.get, here.root + "audit", params={"who": "guest of all", "as": "json"})
        assert eventually(lambda: found().json()["entries"], "the visit noted")[0]["what"] == "INVITATION"


def test_a_guest_can_do_nothing_else(here: AuthenticatedGateway, guest: httpx.Client) -> None:
    """It neither acts nor stops, invites nobody, and sees nothing that takes another right."""
    with here.browsing("all") as browser:
        robot = browser.robot(SEEN)
        stop, lease = browser.action(robot, LF.StopRobot), robot.url + "lease"
    guest.headers["origin"] = here.root[:-1]
    turtle = {"content-type": "text/turtle"}
    asked = [
        guest.post(stop),
        guest.put(lease, content="[] <https://w3id.org/linked-fleet#holder> 'me' .", headers=turtle),
        guest.put(robot.url + "maximumSpeedScale", content="", headers=turtle),
        guest.post(here.root + "invitations", content=_BODY.format("2026-12-24T00:00:00Z"), headers=turtle),
        guest.get(here.root + "invitations"),
        guest.get(here.root + "audit"),
        guest.get(here.root + "subscriptions"),
        guest.get(here.root, headers={"accept": "text/event-stream"}),
        guest.delete(robot.url),
    ]
    assert [each.status_code for each in asked] == [403] * len(asked), [each.text for each in asked]


def test_the_token_of_a_link_is_no_bearer_token(here: AuthenticatedGateway) -> None:
    _, link = invited(here)
    headers = {"authorization": f"Bearer {link.partition('=')[2]}"}
    assert httpx.get(here.root, headers=headers).status_code == 401
    form = {"token": link.partition("=")[2], "then": "/"}
    assert httpx.post(here.root + "login", data=form, headers={"origin": here.root[:-1]}).status_code == 401


def test_revoking_ends_the_sessions_of_guests(here: AuthenticatedGateway) -> None:
    location, link = invited(here)
    with httpx.Client(timeout=20) as client, here.browsing("all") as browser:
        client.get(link)
        assert client.get(here.root).status_code == 200
        assert browser.http.delete(location).status_code == 204
        assert client.get(here.root).status_code == 401
        client.cookies.clear()
        again = client.get(link, headers=_HTML)
        assert again.status_code == 401 and "There is no such invitation, or it was revoked." in again.text
        assert "set-cookie" not in again.headers


def test_a_link_is_opened_so_often_at_once(here: AuthenticatedGateway) -> None:
    """Each opening is in the audit, which must keep room for what others do."""
    _, link = invited(here)
    with httpx.Client(timeout=20) as client:
        for _ in range(FAILURES):
            assert client.get(link, headers=_HTML).status_code == 303
            client.cookies.clear()
        answer = client.get(link, headers=_HTML)
        assert answer.status_code == 429 and "opened too often" in answer.text
        assert "set-cookie" not in answer.headers and int(answer.headers["retry-after"]) > 0


def test_inviting_takes_the_right_to_read_all_that_guests_see(here: AuthenticatedGateway) -> None:
    here.add("deputy", "admin")
    here.known("deputy")
    invited(here, by="deputy", status=403)


def test_who_watches_the_whole_fleet_does_not_hear_of_invitations(here: AuthenticatedGateway) -> None:
    here.add("watcher", "read", "subscribe")
    here.known("watcher")
    token = f"Bearer {here.tokens['watcher']}"
    with Socket(here.root + "?depth=subtree", Authorization=token) as open_, here.browsing("all") as browser:
        open_.raw()
        invited(here)
        fault = {"about": f"{here.root}{SEEN}/", "title": "It rattles."}
        assert browser.http.post(here.root + "actions/raiseFault", json=fault).is_success
        heard = ""
        while "It rattles." not in heard:
            heard += str(open_.raw())
        assert "/invitations/" not in heard and "the visitors" not in heard


def test_the_link_is_told_once(here: AuthenticatedGateway) -> None:
    location, link = invited(here)
    token = link.partition("=")[2]
    with here.browsing("all") as browser:
        for url in (location, here.root + "invitations"):
            for media_type in ("text/turtle", "text/html", "application/ld+json"):
                said = browser.http.get(url, headers={"accept": media_type}).text
                assert token not in said and module.hash_of(token) not in said and "the visitors" in said
        graph = rdflib.Graph().parse(data=browser.http.get(location).text, publicID=location)
        assert str(graph.value(URIRef(location), DCTERMS.title)) == "the visitors"


@pytest.mark.parametrize("token", ["", "x", "lfi_" + "A" * 43, "lfi_" + "é" * 43, "lf_" + "A" * 43, "A" * 3000])
def test_a_forged_link_is_refused(here: AuthenticatedGateway, token: str) -> None:
    invited(here)
    answer = httpx.get(here.root + "login/invitation", params={"token": token}, headers=_HTML)
    assert answer.status_code == 401 and "set-cookie" not in answer.headers


@pytest.mark.parametrize("by", ["reader", "actor", "lab", "stopper"])
def test_inviting_takes_the_right_to_administer_all(here: AuthenticatedGateway, by: str) -> None:
    invited(here, by, status=403)


@pytest.mark.parametrize("hours", [-1.0, 31 * 24.0])
def test_an_invitation_ends_within_thirty_days(here: AuthenticatedGateway, hours: float) -> None:
    _, said = invited(here, hours=hours, status=422)
    assert "An invitation ends within 30 days" in said


def test_somebody_who_is_logged_in_stays_it(here: AuthenticatedGateway) -> None:
    """Nobody becomes a guest by a link on another page."""
    _, link = invited(here)
    with httpx.Client(timeout=20) as client:
        form = {"token": here.tokens["all"], "then": "/"}
        client.post(here.root + "login", data=form, headers={"origin": here.root[:-1]})
        answer = client.get(link, headers=_HTML)
        assert answer.status_code == 409 and "You are logged in as all." in answer.text


def test_it_ends_by_itself(here: AuthenticatedGateway) -> None:
    """Also the sessions that have begun with it. Afterwards the link says when it ended."""
    _, link = invited(here, hours=2 / 3600)
    with httpx.Client(timeout=20) as client:
        if client.get(link).status_code == 303:  # else it was over before

            def over() -> bool:
                return client.get(here.root).status_code == 401

            eventually(over, "the session over")
        client.cookies.clear()
        said = client.get(link, headers=_HTML)
        assert said.status_code == 401 and "This invitation ended at" in said.text


async def test_expired_ones_are_forgotten_after_a_week() -> None:
    now_ns = time.time_ns()
    known = {
        "old": module.Invitation("old", now_ns - module.KEPT_NS - 1),
        "over": module.Invitation("over", now_ns - 1),
        "good": module.Invitation("good", now_ns + 10**9),
    }

    class Records:
        def __init__(self) -> None:
            self.known = dict(known)

        async def change(self, id: str, record: object) -> bool:
            assert record is None
            del self.known[id]
            return True

    records = Records()
    await module.Invitations(records, lambda id, invitation: None).forget_expired()  # type: ignore[arg-type]
    assert records.known.keys() == {"over", "good"}
