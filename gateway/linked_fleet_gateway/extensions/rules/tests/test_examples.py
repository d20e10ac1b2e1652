"""The examples of the page of rules work on the robots of the demo: each is saved as it is, fires, and acts."""

from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from rdflib import URIRef

from browser import LDP, LF, MATHS, Browser
from commanding import PREFIXES, of_joint, of_robot, radian, slowly
from linked_fleet_demo.tree import PLACES
from linked_fleet_gateway.extensions.rules.page import GREET, KEEP_AWAY, UPRIGHT, Example
from rules_client import TURTLE, fired, firings, posted
from running import eventually

pytestmark = [pytest.mark.virtual, pytest.mark.test_all]


def saved(browser: Browser, example: Example) -> str:
    """The IRI of the rule that the form of the page makes of an example, once it is evaluated."""
    apart = "".join(f'; lf:toldApartBy "{name}" ' for name in example.told_apart_by.split())
    body = "; lf:body _:body " if example.body else ""
    said = f'a lf:Rule ; dcterms:title "{example.title}" ; lf:condition """{example.condition}""" '
    rule = posted(browser, f"{PREFIXES}<> {said}; lf:invokes <{example.invokes}> {body}{apart}.\n{example.body}")
    eventually(lambda: browser.page(rule).one(LF.state) == LF.active, f"{example.title} evaluated")
    assert firings(browser, rule) == []
    return rule


def place(browser: Browser, robot: str, x: float, y: float, z: float) -> None:
    body = f"{PREFIXES}<> lf:position [ maths:x {x} ; maths:y {y} ; maths:z {z} ; vom:unit unit:M ] ."
    answer = browser.http.put(str(browser.robot(robot).one(LF.placement)), content=body, headers=TURTLE)
    assert answer.is_success, answer.text


@pytest.fixture(autouse=True)
def as_in_the_demo(browser: Browser) -> Iterator[None]:
    for robot in browser.robots():
        name = urlsplit(robot.url).path.strip("/")
        place(browser, name, *PLACES[name])
    yield
    container = browser.page(str(browser.page(browser.root).one(LF.rules)))
    for rule in container.graph.objects(None, LDP.contains):
        assert browser.http.delete(str(rule)).status_code == 204
    stop = browser.action(browser.page(browser.root), LF.StopAll)
    assert browser.http.post(stop).is_success


def move(browser: Browser, body: str) -> str:
    answer = browser.http.post(of_joint(browser, "wrist_3_joint"), content=body, headers=TURTLE)
    assert answer.is_success, answer.text
    return str(answer.headers["location"])


def invoked(browser: Browser, rule: str) -> URIRef:
    """The invocation of the only firing, which was accepted."""
    assert [state for state, _ in fired(browser, rule, 1)] == ["accepted"]
    firing = f"{browser.page(rule).one(LF.firings)}/1"
    return browser.page(firing).one(LF.invocation)


def succeeded(browser: Browser, iri: str) -> bool:
    return browser.page(iri).one(LF.state) == LF.succeeded


def test_the_ur5_stands_up_when_its_wrist_turns_too_far(browser: Browser) -> None:
    rule = saved(browser, UPRIGHT)
    move(browser, radian(1.2))
    done = str(invoked(browser, rule))
    assert done.startswith(of_robot(browser, LF.AssumePose))
    eventually(lambda: succeeded(browser, done), "upright")


def test_the_panda_opens_its_hand_when_the_ur5_moves(browser: Browser) -> None:
    rule = saved(browser, GREET)
    move(browser, radian(-0.5))
    done = str(invoked(browser, rule))
    assert done.startswith(browser.part("panda", "panda_finger_joint1").url)
    eventually(lambda: succeeded(browser, done), "an open hand")


def test_the_ur5_stops_when_it_comes_near_to_the_panda(browser: Browser) -> None:
    """The Panda is put beside the tool while a joint of the UR5 turns."""
    rule = saved(browser, KEEP_AWAY)
    task = move(browser, slowly(2.5))
    tool, hand = (_place_in_world(browser, *each) for each in (("ur5", "tool0"), ("panda", "panda_hand")))
    place(browser, "panda", *(there + to - at for there, to, at in zip(PLACES["panda"], tool, hand, strict=True)))
    assert [state for state, _ in fired(browser, rule, 1)] == ["accepted"]
    eventually(lambda: browser.page(task).one(LF.state) not in (LF.accepted, LF.running), "a stopped joint")
    assert browser.page(task).one(LF.state) == LF.cancelled


def _place_in_world(browser: Browser, robot: str, link: str) -> list[float]:
    """In metre."""
    page = browser.page(f"{browser.root}world/pose?of={browser.root}{robot}/{link}")
    position = page.one(LF.position)
    (node,) = [each for each in page.graph.objects(None, LF.position)]
    assert position
    return [float(page.graph.value(node, axis)) for axis in (MATHS.x, MATHS.y, MATHS.z)]  # type: ignore[arg-type]
