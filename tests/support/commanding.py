"""Commands as a client sends them, found by links: the actions of a thing, their bodies, and their outcomes."""

import contextlib
import math
from collections.abc import Callable, Iterator

import httpx
from rdflib import URIRef

from browser import LDP, LF, ROS, SPATIAL, VOM, Browser, Page
from gateway_group import Gateway
from graphs import read
from running import Process, eventually, process
from small_fleet import live

TURTLE = {"content-type": "text/turtle"}
PREFIXES = """@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix dcterms: <http://purl.org/dc/terms/> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> .
@prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
@prefix lf: <https://w3id.org/linked-fleet#> .
"""
PROBLEMS = "https://w3id.org/linked-fleet/problems#"
PAN, LIFT, WRIST = "shoulder_pan_joint", "shoulder_lift_joint", "wrist_3_joint"
ENDED = (LF.succeeded, LF.failed, LF.cancelled, LF.preempted)
STILL_RAD = 0.02
"""Tolerance for a joint that stands still and may be settling."""


# -- what to say ----------------------------------------------------------------------------------------------------


def radian(value: float, more: str = "") -> str:
    return PREFIXES + f"<> vom:numericalValue {value} ; vom:unit unit:RAD {more} ."


def slowly(value: float, more: str = "", speed: float = 0.1) -> str:
    """Return a body for ``value`` rad at no more than ``speed`` rad/s."""
    return radian(value, f"; lf:speed [ vom:numericalValue {speed} ; vom:unit unit:RAD-PER-SEC ] {more}")


def expecting(joint: str, value: float, tolerance: float) -> str:
    """Return Turtle for a precondition: the position of a joint in rad."""
    where = f"lf:ofJoint <{joint}> ; vom:numericalValue {value} ; vom:unit unit:RAD ; lf:tolerance {tolerance}"
    return f"; lf:precondition [ {where} ]"


def control(holder: str, duration_s: float) -> str:
    return PREFIXES + f'<> lf:holder "{holder}" ; lf:leaseDuration {duration_s} .'


# -- where to say it ------------------------------------------------------------------------------------------------


def of_joint(browser: Browser, joint: str, kind: URIRef = LF.Rotate, robot: str = "ur5") -> str:
    return browser.found((robot, joint, kind), lambda: browser.action(browser.part(robot, joint), kind))


def of_robot(browser: Browser, kind: URIRef, robot: str = "ur5") -> str:
    return browser.found((robot, kind), lambda: browser.action(browser.robot(robot), kind))


def stop_all(browser: Browser) -> str:
    """Return the action that stops the fleet."""
    return browser.found(("", LF.StopAll), lambda: browser.action(browser.page(browser.root), LF.StopAll))


def put(browser: Browser, url: str, body: str, **fields: str) -> httpx.Response:
    return browser.http.put(url, content=body, headers=TURTLE | fields, timeout=70)


def post(browser: Browser, url: str, body: str = "", **fields: str) -> httpx.Response:
    headers = TURTLE | fields if body else fields
    return browser.http.post(url, content=body, headers=headers, timeout=70)


def begun(answer: httpx.Response) -> str:
    """Return the IRI of the invocation that the request began."""
    assert answer.status_code == 204, answer.text
    return answer.headers["location"]


def problem(answer: httpx.Response) -> tuple[int, str]:
    """Return the status and the code of a problem document."""
    assert answer.headers["content-type"] == "application/problem+json", answer.text
    assert answer.json()["detail"]
    return answer.status_code, answer.json()["type"].removeprefix(PROBLEMS)


# -- what became of it ----------------------------------------------------------------------------------------------


def angle(browser: Browser, joint: str, robot: str = "ur5") -> float:
    """Return the position of the joint in rad; NaN if it is unknown."""
    find = lambda: str(browser.part(robot, joint).one(ROS.rotation))  # noqa: E731
    page = browser.page(browser.found((robot, joint), find))
    value = page.graph.value(page.graph.value(page.iri, SPATIAL.rotationAngle), VOM.numericalValue)
    return math.nan if value == LF.unknown else float(str(value))


def moving(browser: Browser, joint: str, robot: str = "ur5", by: float = 0.03) -> None:
    """Wait until the joint has left its position."""
    start = angle(browser, joint, robot)
    eventually(lambda: abs(angle(browser, joint, robot) - start) > by, f"{joint} moving")


def ended(browser: Browser, url: str) -> Page:
    """Wait until the invocation has ended, and return its page."""

    def probe() -> Page | None:
        page = browser.page(url)
        return page if page.one(LF.state) in ENDED else None

    return eventually(probe, f"the end of {url}")


def reason(page: Page) -> str:
    return str(page.graph.value(page.iri, LF.reason) or "")


def state_at(gateway: Gateway, invocation: str) -> URIRef | None:
    """Return the state of an invocation at this gateway; None while the gateway does not know it."""
    url = gateway.here(invocation)
    answer = gateway.get(url)
    if answer.status_code == 404:
        return None
    assert answer.status_code == 200, answer.text
    # From this response: it may be deleted before the next request.
    state = read(answer.text, url).value(URIRef(url), LF.state)
    assert isinstance(state, URIRef)
    return state


def invocations(browser: Browser, action: str) -> list[str]:
    """Return the paths of the invocations that an action lists, in any order."""
    page = browser.page(str(browser.page(action).one(LF.invocations)))
    return [httpx.URL(str(each)).path for each in page.graph.objects(page.iri, LDP.contains)]


# -- who carries it out ---------------------------------------------------------------------------------------------


@contextlib.contextmanager
def arm(endpoint: str, *flags: str) -> Iterator[Process]:
    """Run the agent of a simulated UR5."""
    with process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", endpoint, *flags) as agent:
        yield agent


def all_see(gateways: list[Gateway], robot: str = "ur5") -> None:
    for each in gateways:
        live(each.browser, robot)


def at_all(gateways: list[Gateway], probe: Callable[[Gateway], object], what: str) -> None:
    """Wait until the probe is true for every gateway."""
    for each in gateways:
        eventually(lambda each=each: probe(each), f"{what} at {each.browser.root}")
