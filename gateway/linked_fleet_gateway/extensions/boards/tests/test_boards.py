"""Boards show numbers of several robots, are shared by gateways, and hidden as their robots are."""

from collections.abc import Iterator

import httpx
import pytest
from rdflib import URIRef

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import LF, Browser
from gateway_group import Gateway
from redis_servers import Servers
from running import eventually
from subscribers import members

pytestmark = pytest.mark.virtual
ELBOW = "elbow_joint/rotation"


def save(browser: Browser, *lines: str, title: str = "Elbows") -> httpx.Response:
    return browser.http.post(
        browser.root + "boards", json={"title": title, "lines": [browser.root + each for each in lines]}
    )


def listed(browser: Browser) -> set[str]:
    return members(browser.page(browser.root + "boards"))


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        one.add("admin", *ALL)
        one.add("ann", "read", "act")
        one.add("lab", "read", "act", robots=("lab-*",))
        one.add("reader", "read")
        one.known("reader")
        yield one


def test_a_board_has_lines_of_several_robots(here: AuthenticatedGateway) -> None:
    with here.browsing("ann") as ann, here.browsing("reader") as reader:
        lines = f"{SEEN}/{ELBOW}", f"{HIDDEN}/{ELBOW}"
        url = save(ann, *lines).headers["location"]
        page = reader.page(url)
        assert set(page.graph.objects(page.iri, LF.boardLine)) == {URIRef(ann.root + each) for each in lines}
        html = reader.http.get(url, headers={"accept": "text/html"}).text
        assert all(f'data-line="{ann.root}{each}"' in html for each in lines)
        changed = ann.http.put(url, json={"title": "Elbow", "lines": [ann.root + lines[0]]})
        assert changed.status_code == 204, changed.text
        assert f'href="{ann.root}boards"' in reader.http.get(ann.root, headers={"accept": "text/html"}).text
        assert ann.http.delete(url).status_code == 204 and url not in listed(reader)


def test_who_sees_not_all_of_its_robots_sees_no_board(here: AuthenticatedGateway) -> None:
    with here.browsing("ann") as ann, here.browsing("lab") as lab:
        url = save(ann, f"{SEEN}/{ELBOW}", f"{HIDDEN}/{ELBOW}").headers["location"]
        assert lab.http.get(url).status_code == 404 and url not in listed(lab)
        hidden, nothing = (save(lab, f"{each}/{ELBOW}").json()["detail"] for each in (HIDDEN, "nobody"))
        assert hidden.replace(HIDDEN, "nobody") == nothing
        assert ann.http.delete(url).status_code == 204


@pytest.mark.parametrize(
    "line",
    ["nobody/elbow_joint/rotation", f"{SEEN}/", f"{SEEN}/elbow_joint", f"{SEEN}/elbow_joint/nose", f"{SEEN}/title",
     f"{SEEN}/jointState", f"{SEEN}/upper_arm_link/pose", f"{SEEN}/elbow_joint/target", "boards", "%ff/x", ""],
)  # fmt: skip
def test_a_line_is_a_property_with_one_measured_number(here: AuthenticatedGateway, line: str) -> None:
    with here.browsing("ann") as ann:
        answer = save(ann, line)
        assert answer.status_code == 422 and "no property with one measured number" in answer.text, answer.text


def test_boards_take_the_right_to_act_and_properties_of_this_fleet(here: AuthenticatedGateway) -> None:
    with here.browsing("reader") as reader, here.browsing("ann") as ann:
        assert save(reader, f"{SEEN}/{ELBOW}").status_code == 403
        foreign = {"title": "x", "lines": [f"http://elsewhere.example/{SEEN}/{ELBOW}"]}
        answer = ann.http.post(ann.root + "boards", json=foreign)
        assert answer.status_code == 422 and "of this fleet" in answer.text
        for title in ("", " ", "\x07", "x" * 101):
            assert save(ann, f"{SEEN}/{ELBOW}", title=title).status_code == 422
        assert save(ann).status_code == 422
        assert save(ann, *(f"{SEEN}/{each}/{ELBOW}" for each in range(25))).status_code == 422


def test_gateways_share_boards_which_outlive_their_robots(two_and_store: tuple[Servers, Gateway, Gateway]) -> None:
    memory, one, other = two_and_store
    path = save(one.browser, f"ur5/{ELBOW}", "ur5/wrist_1_joint/rotation").headers["location"]
    path = path.removeprefix(one.browser.root)
    eventually(lambda: other.get(other.browser.root + path).status_code == 200, "the board at the other gateway")
    memory.kill()
    assert save(one.browser, f"ur5/{ELBOW}").status_code == 503
    assert one.get(one.browser.root + path).status_code == 200
