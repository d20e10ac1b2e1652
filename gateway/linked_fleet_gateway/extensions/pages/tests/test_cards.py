"""The cards of a fleet say what each robot does, how far it is, for whom, and who has control of it."""

from collections.abc import Iterator

import pyshacl
import pytest

from browser import LF, Browser
from commanding import control, put
from running import eventually
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"


@pytest.fixture
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("cards"))
    with place.ur5(), place.gateway() as (_, browser):
        live(browser, "ur5")
        yield browser


def card(browser: Browser) -> str:
    page = browser.http.get(browser.root, headers={"accept": "text/html"}).text
    return page.partition('data-robot="')[2].partition("</li>")[0]


def test_a_card_says_what_a_robot_does_how_far_it_is_and_for_whom(browser: Browser) -> None:
    assert "data-holder hidden" in card(browser) and "data-out hidden" in card(browser)
    answer = put(browser, str(browser.robot("ur5").one(LF.lease)), control("Ada <3", 60))
    token = answer.headers["lock-token"]
    assert browser.http.put(f"{browser.root}ur5/availability", json={"inService": False, "reason": "worn"}).is_success
    assert "controlled by </span><bdi>Ada &lt;3</bdi>" in card(browser)
    assert "out of service: <bdi>worn</bdi>" in card(browser)
    body = {"value": 2.0, "unit": RAD, "speedScale": 0.2}
    turn = f"{browser.root}ur5/wrist_3_joint/actions/rotate"
    answer = browser.http.post(turn, json=body, headers={"lock-token": token})
    assert answer.status_code == 204, answer.text
    for share in (10, 50, 90):
        eventually(lambda share=share: f"{share} % for 127.0.0.1" in card(browser), f"{share} %")  # type: ignore[misc]
    fleet = browser.page(browser.root)
    shapes = browser.page(f"{browser.root}blueprint").graph
    conforms, _, text = pyshacl.validate(fleet.graph, shacl_graph=shapes)
    assert conforms, text
    eventually(lambda: ">idle<" in card(browser), "the end")
