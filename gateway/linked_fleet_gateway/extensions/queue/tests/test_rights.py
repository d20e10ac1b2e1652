"""An order has the present rights of who wrote it, is hidden with its robots, and is bounded and moved by right."""

from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import LDP, Browser
from running import eventually

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded"), "--queue-per-client", "5") as one:
        one.add("admin", *ALL)
        one.add("reader", "read")
        one.add("writer", "read", "act", robots=("lab-*",))
        one.add("other", "read", "act", robots=("lab-*",))
        one.add("hall", *ALL, robots=("hall-*",))
        one.add("both", "read", "act")
        one.known("both")
        yield one


def mission(browser: Browser, robot: str, *before: dict[str, Any]) -> str:
    action = f"{browser.root}{robot}/wrist_3_joint/actions/rotate"
    turn = {"type": "invoke", "action": action, "body": {"value": 0.2, "unit": RAD}}
    step = {"type": "sequence", "steps": [*before, turn]}
    return browser.http.post(browser.root + "missions", json={"title": "turn", "step": step}).headers["location"]


def order(browser: Browser, mission: str, **more: Any) -> httpx.Response:
    return browser.http.post(browser.root + "queue", json={"mission": mission, **more})


def told(browser: Browser, iri: str) -> dict[str, Any]:
    found: dict[str, Any] = browser.http.get(iri, headers={"accept": "application/json"}).json()
    return found


LONG = {"type": "wait", "seconds": 600}


def is_over(browser: Browser, iri: str) -> bool:
    return told(browser, iri)["state"] not in ("waiting", "starting", "running")


def clear(here: AuthenticatedGateway) -> None:
    """Withdraw and delete all orders."""
    with here.browsing("admin") as admin:
        for each in map(str, admin.page(admin.root + "queue").graph.objects(None, LDP.contains)):
            admin.http.post(f"{each}/actions/withdraw")
            eventually(lambda each=each: is_over(admin, each), "the end")  # type: ignore[misc]
            assert admin.http.delete(each).status_code == 204


def test_ordering_takes_the_right_to_run_the_mission(here: AuthenticatedGateway) -> None:
    with here.browsing("reader") as reader, here.browsing("both") as both, here.browsing("hall") as hall:
        iri = mission(both, SEEN)
        assert order(reader, iri).status_code == 403
        assert order(hall, iri).status_code == 422
        assert order(both, iri).status_code == 201
    clear(here)


def test_orders_are_hidden_with_their_robots(here: AuthenticatedGateway) -> None:
    with here.browsing("hall") as hall, here.browsing("both") as both:
        iri = order(both, mission(both, SEEN, LONG)).headers["location"]
        assert both.http.get(iri).status_code == 200
        for path in (iri, iri + "/actions/withdraw"):
            assert hall.http.get(path).status_code == 404
        page = hall.page(hall.root + "queue")
        assert not list(page.graph.objects(None, LDP.contains)) and SEEN not in page.response.text
    clear(here)


def test_an_order_of_ones_own_is_withdrawn_and_others_by_right(here: AuthenticatedGateway) -> None:
    with here.browsing("writer") as writer, here.browsing("reader") as reader, here.browsing("other") as other:
        iri = order(writer, mission(writer, SEEN, LONG)).headers["location"]
        assert reader.http.post(iri + "/actions/withdraw").status_code == 403
        assert other.http.post(iri + "/actions/withdraw").status_code == 204
    clear(here)


def test_moving_before_orders_of_others_takes_the_right_to_administer(here: AuthenticatedGateway) -> None:
    with here.browsing("writer") as writer, here.browsing("other") as other, here.browsing("admin") as admin:
        iri = mission(writer, SEEN, LONG)
        first = order(writer, iri).headers["location"]
        eventually(lambda: told(writer, first)["state"] == "running", "the first order")
        theirs = order(writer, iri).headers["location"]
        own = [order(other, iri).headers["location"] for _ in range(2)]
        assert other.http.post(own[1] + "/actions/move", json={"before": own[0]}).status_code == 204
        assert other.http.post(own[1] + "/actions/move", json={"before": theirs}).status_code == 403
        assert other.http.post(own[1] + "/actions/move", json={"after": theirs}).status_code == 204
        assert admin.http.post(own[1] + "/actions/move", json={"before": theirs}).status_code == 204
    clear(here)


def test_a_client_may_have_so_many_orders_wait(here: AuthenticatedGateway) -> None:
    with here.browsing("writer") as writer, here.browsing("other") as other:
        iri = mission(writer, SEEN, LONG)
        first = order(writer, iri).headers["location"]
        eventually(lambda: told(writer, first)["state"] == "running", "the first order")
        assert [order(writer, iri).status_code for _ in range(6)] == [201] * 5 + [409]
        assert "5 of your orders are waiting" in order(writer, iri).json()["detail"]
        assert order(other, iri).status_code == 201
    clear(here)


def test_a_right_that_has_ended_ends_the_order(here: AuthenticatedGateway) -> None:
    here.add("guest", "read", "act")
    here.known("guest")
    with here.browsing("guest") as guest, here.browsing("both") as both:
        slow = order(both, mission(both, SEEN, LONG)).headers["location"]
        eventually(lambda: told(both, slow)["state"] == "running", "the order before")
        late = order(guest, mission(guest, SEEN)).headers["location"]
        here.revoke("guest")
        eventually(lambda: guest.http.get(guest.root).status_code == 401, "the guest is gone")
        assert both.http.post(slow + "/actions/withdraw").status_code == 204
        eventually(lambda: told(both, late)["state"] == "failed", lambda: str(told(both, late)))
        assert "rights" in told(both, late)["reason"]
    clear(here)


def test_who_changes_an_order_answers_for_it(here: AuthenticatedGateway) -> None:
    with here.browsing("both") as both, here.browsing("other") as other:
        slow = order(both, mission(both, SEEN, LONG)).headers["location"]
        eventually(lambda: told(both, slow)["state"] == "running", "the order before")
        iri = order(both, mission(both, SEEN)).headers["location"]
        hidden = mission(both, HIDDEN)
        assert other.http.put(iri, json={"mission": hidden}).status_code == 422
        assert other.http.put(iri, json={"mission": told(both, iri)["mission"], "priority": 1}).status_code == 204
        assert told(both, iri)["creator"] == "other"
    clear(here)
