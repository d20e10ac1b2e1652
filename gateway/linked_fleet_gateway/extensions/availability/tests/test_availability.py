"""A robot is taken out of service and returned, also while it is offline, by those who administer it."""

import contextlib
from collections.abc import Iterator

import pytest
from rdflib import RDF, Literal, URIRef

from authenticated_gateway import SEEN, AuthenticatedGateway, run_with_driver
from browser import LF, Browser
from gateway_group import Gateway, gateways, hub
from redis_servers import single
from running import eventually, process
from small_fleet import live, offline

pytestmark = pytest.mark.virtual


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_with_driver(tmp_path_factory.mktemp("guarded")) as one:
        yield one


def put(browser: Browser, robot: str, in_service: bool, reason: str = "") -> int:
    body = {"inService": in_service} | ({"reason": reason} if reason else {})
    return browser.http.put(f"{browser.root}{robot}/availability", json=body).status_code


def told(browser: Browser, robot: str) -> tuple[str, str]:
    page = browser.page(f"{browser.root}{robot}/availability")
    return str(page.one(LF.inService)), str(page.graph.value(page.iri, LF.reason) or "")


def test_it_takes_the_right_to_administer_and_a_reason(here: AuthenticatedGateway) -> None:
    with here.browsing("driver") as driver, here.browsing("admin") as admin:
        assert told(driver, SEEN) == ("true", "")
        assert put(driver, SEEN, False, "worn") == 403
        assert put(admin, SEEN, False) == 422
        assert put(admin, SEEN, False, "worn") == 204
        assert told(driver, SEEN) == ("false", "worn")
        robot = driver.robot(SEEN)
        property_ = URIRef(f"{driver.root}{SEEN}/availability")
        assert (robot.iri, LF.availability, property_) in robot.graph
        assert (property_, RDF.type, LF.Availability) in driver.page(str(property_)).graph
        assert put(admin, SEEN, True) == 204
        assert told(driver, SEEN) == ("true", "")


@pytest.fixture
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Gateway]]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        agent = process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", centre.endpoint)
        found = stack.enter_context(gateways(centre, memory.url))
        with agent:
            for each in found:
                live(each.browser, "ur5")
        yield found


def test_an_offline_robot_is_taken_out_of_service_at_all_gateways(pair: list[Gateway]) -> None:
    one, other = pair
    offline(one.browser, "ur5")
    assert put(one.browser, "ur5", False, "gearbox") == 204
    eventually(lambda: told(other.browser, "ur5") == ("false", "gearbox"), "the other gateway")
    found = other.browser.http.get(f"{other.browser.root}ur5/availability", headers={"accept": "application/json"})
    assert found.json() | {"inService": False, "reason": "gearbox"} == found.json()
    assert Literal(False) in other.browser.page(f"{other.browser.root}ur5/availability").graph.objects()
