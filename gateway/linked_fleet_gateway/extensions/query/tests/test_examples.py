"""The example queries on the endpoint's page, with the robots of the demo."""

from collections.abc import Iterator

import httpx
import pytest

from browser import LF, SH, Browser
from commanding import begun, of_joint, post, radian, slowly
from linked_fleet_gateway.extensions.query.examples import EXAMPLES, MOVING, NEAR_LIMITS, REACH, Example
from running import eventually, process
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
ROBOTS = ("baxter", "ur5", "panda", "tiago", "go2")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("state"))
    robots = [f"--robot={name}" for name in ROBOTS]
    with place.gateway() as (_, browser), process("-m", "linked_fleet_agent", *robots, "--connect", place.zenoh):
        for name in ROBOTS:
            live(browser, name)
        yield browser


def rows(browser: Browser, example: Example) -> list[list[str]]:
    fields = {"content-type": "application/sparql-query", "accept": "text/tab-separated-values"}
    answer: httpx.Response = browser.http.post(
        str(browser.page(browser.root).one(LF.query)), content=example.text, headers=fields, timeout=60
    )
    assert answer.status_code == 200, answer.text
    return [line.split("\t") for line in answer.text.splitlines()[1:]]


def test_the_example_with_reachability_has_an_answer(browser: Browser) -> None:
    """The first time, without warm caches."""
    found = [link.strip("<>").removeprefix(browser.root) for _, link in rows(browser, REACH)]
    assert found == ["baxter/left_gripper", "baxter/right_gripper", "panda/panda_hand", "ur5/tool0"]


def test_a_joint_that_comes_near_its_limit_is_found(browser: Browser) -> None:
    assert "panda_joint1" not in str(rows(browser, NEAR_LIMITS))
    begun(post(browser, of_joint(browser, "panda_joint1", robot="panda"), radian(-2.5)))
    found = eventually(lambda: [row for row in rows(browser, NEAR_LIMITS) if '"panda_joint1"' in row], "near its limit")
    assert len(found) == 1


def test_the_example_finds_motions_with_their_clients(browser: Browser) -> None:
    action = of_joint(browser, "wrist_3_joint")
    begun(post(browser, action, slowly(3.0, speed=0.05)))
    (row,) = [row for row in rows(browser, MOVING) if row[1] == f"<{action}>"]
    assert row[3] == '"127.0.0.1"'
    begun(post(browser, browser.action(browser.robot("ur5"), LF.StopRobot)))


def test_the_page_offers_all_of_them(browser: Browser) -> None:
    page = browser.page(str(browser.page(browser.root).one(LF.query)))
    offered = {str(page.graph.value(each, SH.select)) for each in page.graph.objects(page.iri, LF.example)}
    assert offered == {each.text for each in EXAMPLES}
