"""Stops that hold: who may latch and reset, what is refused meanwhile, and that gateways share them."""

import asyncio
import uuid
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import httpx
import pytest

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import LF, Browser
from fake_robots import FakeRobot, open_session
from gateway_group import Gateway
from linked_fleet_gateway.api import Core, Invocation, Motion, Table
from linked_fleet_gateway.extensions.latches.extension import Latches, StopLatched, _Guard, _heard
from linked_fleet_gateway.extensions.latches.latch import Latch
from linked_fleet_identity.rights import ALL as ALL_ROBOTS
from linked_fleet_state.invocations import Invocations
from parallel import at_once
from redis_servers import Servers
from running import eventually
from small_fleet import Place
from subscribers import members

pytestmark = pytest.mark.virtual
S = 1_000_000_000


def latch(browser: Browser, about: str, **more: str) -> httpx.Response:
    return browser.http.post(browser.root + "stopLatches", json={"about": browser.root + about, **more})


def move(browser: Browser, robot: str = SEEN, **headers: str) -> httpx.Response:
    url = f"{browser.root}{robot}/wrist_3_joint/actions/rotate"
    body = {"value": 0.1, "unit": "http://qudt.org/vocab/unit/RAD"}
    return browser.http.post(url, json=body, headers={"prefer": "respond-async", **headers})


def listed(browser: Browser) -> set[str]:
    return members(browser.page(browser.root + "stopLatches"))


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        one.add("chief", *ALL)
        one.add("ann", "read", "act")
        one.add("guard", "read", "stop")
        one.add("lab", "read", "act", "reset", robots=("lab-*",))
        one.add("reader", "read")
        one.known("reader")
        yield one


@pytest.mark.parametrize("about", [f"{SEEN}/", ""])
def test_motions_are_refused_until_somebody_with_the_right_resets(here: AuthenticatedGateway, about: str) -> None:
    with here.browsing("ann") as ann, here.browsing("guard") as guard, here.browsing("chief") as chief:
        assert move(ann).status_code == 202
        url = latch(guard, about, reason="Somebody is in the cell.").headers["location"]
        for dry in ({}, {"prefer": "dry-run"}):
            refused = move(ann, **dry)
            assert refused.status_code == 409
            said = refused.json()
            assert said["type"].endswith("stop-latched")
            assert "guard stopped" in said["detail"] and "Somebody is in the cell." in said["detail"]
            assert url.removeprefix(ann.root) in said["detail"]
        assert ann.http.post(f"{ann.root}{SEEN}/actions/stop").status_code == 204
        assert ann.http.delete(url).status_code == 403 == guard.http.delete(url).status_code
        page = ann.page(url)
        assert str(page.one(LF.latchAbout)) == ann.root + about
        assert str(page.one(LF.latchedBy)) == "guard"
        html = ann.http.get(f"{ann.root}stopLatches", headers={"accept": "text/html"}).text
        assert "Somebody is in the cell." in html and "Reset" in html
        assert chief.http.delete(url).status_code == 204
        assert move(ann).status_code == 202


def test_a_robot_has_one_latch_and_the_fleet_one(here: AuthenticatedGateway) -> None:
    with here.browsing("chief") as chief:
        first, fleet = latch(chief, f"{SEEN}/").headers["location"], latch(chief, "").headers["location"]
        for about, url in ((f"{SEEN}/", first), ("", fleet)):
            assert latch(chief, about).headers["location"] == url
            again = latch(chief, about, reason="Another one.")
            assert again.status_code == 409 and "holds already" in again.text
        assert listed(chief) == {first, fleet}
        for url in (first, fleet):
            assert move(chief).status_code == 409
            assert chief.http.delete(url).status_code == 204
        assert move(chief).status_code == 202


def test_latching_takes_the_right_to_stop_and_a_robot_that_is_seen(here: AuthenticatedGateway) -> None:
    with here.browsing("reader") as reader, here.browsing("lab") as lab, here.browsing("chief") as chief:
        assert latch(reader, f"{SEEN}/").status_code == 403
        assert latch(lab, "").status_code == 403
        for nothing in ("nobody/", "/", f"/{SEEN}/", SEEN, f"{SEEN}/elbow_joint/", "actions/stopAll", "stopLatches"):
            assert latch(chief, nothing).status_code == 422, nothing
        hidden, nobody = (latch(lab, about) for about in (f"{HIDDEN}/", "nobody/"))
        assert hidden.json()["detail"].replace(HIDDEN, "nobody") == nobody.json()["detail"]
        elsewhere = {"about": f"http://elsewhere.example/{SEEN}/"}
        assert chief.http.post(chief.root + "stopLatches", json=elsewhere).status_code == 422
        url = latch(chief, f"{HIDDEN}/").headers["location"]
        assert lab.http.get(url).status_code == 404 and url not in listed(lab)
        assert chief.http.delete(url).status_code == 204


def test_a_change_keeps_who_stopped_and_what(here: AuthenticatedGateway) -> None:
    with here.browsing("guard") as guard, here.browsing("chief") as chief:
        url = latch(guard, f"{SEEN}/").headers["location"]
        assert chief.http.put(url, json={"about": chief.root, "reason": "x"}).status_code == 409
        changed = chief.http.put(url, json={"about": f"{chief.root}{SEEN}/", "reason": "The belt is torn."})
        assert changed.status_code == 204, changed.text
        page = chief.page(url)
        assert str(page.one(LF.latchAbout)) == f"{chief.root}{SEEN}/" and str(page.one(LF.latchedBy)) == "guard"
        assert str(page.one(LF.reason)) == "The belt is torn."
        assert chief.http.delete(url).status_code == 204


def test_gateways_share_latches_and_known_ones_hold_while_redis_is_away(
    two_and_store: tuple[Servers, Gateway, Gateway],
) -> None:
    memory, one, other = two_and_store
    assert latch(one.browser, "ur5/").status_code == 201
    eventually(lambda: move(other.browser, "ur5").status_code == 409, "the latch at the other gateway")
    memory.kill()
    for each in (one, other):
        refused = move(each.browser, "ur5")
        assert refused.status_code in (409, 503), refused.text
        assert latch(each.browser, "").status_code == 503
        assert each.browser.http.post(each.browser.root + "ur5/actions/stop").status_code == 204


def test_a_robot_whose_name_is_escaped_is_latched(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), open_session(place.zenoh) as session:
        robot = FakeRobot(session, "stopLatches").appear()
        eventually(lambda: "~73topLatches/" in browser.http.get(browser.root).text, "the robot")
        assert latch(browser, "~73topLatches/").status_code == 201
        robot.leave()


def test_two_who_latch_at_the_same_time_make_one(here: AuthenticatedGateway) -> None:
    with here.browsing("chief") as chief:
        answers = at_once([lambda: latch(chief, "")] * 3)
        (url,) = {each.headers["location"] for each in answers}
        assert listed(chief) == {url}
        assert chief.http.delete(url).status_code == 204


def test_a_repeated_request_gets_its_first_answer_also_while_a_stop_holds(here: AuthenticatedGateway) -> None:
    with here.browsing("chief") as chief:
        key = {"idempotency-key": "one-and-only"}
        first = move(chief, **key)
        url = latch(chief, f"{SEEN}/").headers["location"]
        again = move(chief, **key)
        assert (again.status_code, again.headers["location"]) == (first.status_code, first.headers["location"])
        assert move(chief, **{"idempotency-key": "another"}).status_code == 409
        assert chief.http.delete(url).status_code == 204


async def test_what_began_before_a_gateway_heard_of_a_latch_is_cancelled() -> None:
    def begun(id: str, created_ns: int) -> Invocation:
        return Invocation(id, "a", "/a/actions/rotate", {"j": 1.0}, created_ns, 2 * S, client="me")

    invocations, cancelled = Invocations(), list[str]()
    for each in (begun("before", S - 1), begun("after", S + 1)):
        invocations.add(each)

    async def cancel(id: str, reason: str) -> bool:
        cancelled.append(id)
        return True

    live = SimpleNamespace(invocations=invocations, fan_out=SimpleNamespace(add_resource=lambda path: None))
    core = cast(Core, SimpleNamespace(live=live, cancel=cancel, mark_changed=lambda *paths: None))
    tasks = set[asyncio.Task[None]]()
    _heard(core, tasks, "1", None, Latch("b", since_ns=S))
    _heard(core, tasks, "1", None, Latch("a", since_ns=S))
    await asyncio.gather(*tasks)
    assert cancelled == ["after"]


async def test_a_stop_whose_record_cannot_be_read_holds_until_it_is_reset() -> None:
    """Its id says of which robot it is."""
    ids = [str(uuid.uuid5(uuid.NAMESPACE_URL, path)) for path in ("/a/", "/gone/")]
    table = SimpleNamespace(known={}, unreadable=ids)
    latches = Latches(cast(Table[Latch], table), ["a", "b"])
    assert {id: each.robot for id, each in latches.known.items()} == {ids[0]: "a"}
    guard = _Guard(latches)
    motions = [cast(Motion, SimpleNamespace(robot=SimpleNamespace(name=each))) for each in "ab"]
    with pytest.raises(StopLatched, match=f"cannot be read.*/stopLatches/{ids[0]}"):
        await guard.check_path(motions[0], ALL_ROBOTS, "")
    assert (await guard.check_path(motions[1], ALL_ROBOTS, "")).free
    table.unreadable.remove(ids[0])
    assert (await guard.check_path(motions[0], ALL_ROBOTS, "")).free
