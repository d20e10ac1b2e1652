"""One request stops a whole fleet: five simulated robots at full speed, behind one gateway."""

from collections.abc import Iterator

import pytest
import rdflib
from rdflib import URIRef

from browser import LF, Browser
from commands import Commanded
from running import eventually
from simulated_robots import RESTING_RAD_S, SimulatedRobot, simulated
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

POSES = {"baxter": "untucked", "ur5": "upright", "panda": "upright", "tiago": "folded", "go2": "crouched"}
_MOVING_RAD_S = 0.03


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Browser, dict[str, SimulatedRobot]]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), simulated(place.zenoh, *POSES) as robots:
        for name in robots:
            live(browser, name)
        yield browser, robots


@pytest.fixture
def robots(fleet: tuple[Browser, dict[str, SimulatedRobot]]) -> Iterator[dict[str, SimulatedRobot]]:
    """Yield the robots; the test fails if a limit of a URDF is exceeded, or if one falls."""
    _, robots = fleet
    yield robots
    for robot in robots.values():
        robot.check_limits()
        assert robot.upright() > 0.99


def _set_going(browser: Browser, robots: dict[str, SimulatedRobot]) -> dict[str, str]:
    """Begin a motion of each robot, wait until all move, and return the invocations."""
    clients = {name: Commanded(browser, name) for name in robots}
    for name, client in clients.items():
        client.assume("home")
        robots[name].watch()
    begun = {
        name: client.begin(LF.AssumePose, f'<> lf:poseName "{POSES[name]}" ; lf:speedScale 0.05 .')
        for name, client in clients.items()
    }
    eventually(lambda: all(robot.speed() > _MOVING_RAD_S for robot in robots.values()), "five robots moving")
    return begun


def _answers(graph: rdflib.Graph, invocation: URIRef) -> dict[str, str]:
    """Return each robot's answer, by its IRI."""
    nodes = graph.objects(invocation, LF.answer)
    return {str(graph.value(node, LF.ofRobot)): str(graph.value(node, LF.reason)) for node in nodes}


def test_stop_all_brings_every_robot_to_rest(
    fleet: tuple[Browser, dict[str, SimulatedRobot]], robots: dict[str, SimulatedRobot]
) -> None:
    """Each robot answers, comes to rest short of its target and stays; each motion is cancelled and names the cause."""
    browser, _ = fleet
    begun = _set_going(browser, robots)
    url = browser.action(browser.page(browser.root), LF.StopAll)
    answer = browser.http.post(url, headers={"prefer": "wait=60"}, timeout=90)
    assert answer.status_code == 204, answer.text
    stop = browser.page(answer.headers["location"])
    assert stop.one(LF.state) == LF.succeeded, stop.response.text
    assert _answers(stop.graph, stop.iri) == {robot.url: "succeeded" for robot in browser.robots()}
    assert set(stop.graph.objects(stop.iri, LF.preempts)) == {URIRef(url) for url in begun.values()}
    rested = {name: robot.positions() for name, robot in robots.items()}
    for name, robot in robots.items():
        assert robot.speed() <= RESTING_RAD_S, name
        target = robot.poses[POSES[name]]
        assert any(abs(rested[name][joint] - target[joint]) > 0.1 for joint in target), name
        page = browser.page(begun[name])
        assert (page.one(LF.state), page.one(LF.preemptedBy)) == (LF.cancelled, stop.iri)
    for robot in robots.values():
        robot.watch()
    eventually(lambda: all(len(robot.steps) > 400 for robot in robots.values()), "the simulations going on")
    for name, robot in robots.items():
        assert robot.positions() == pytest.approx(rested[name], abs=1e-3), name


def test_rehearsed_stop_all_stops_nobody(
    fleet: tuple[Browser, dict[str, SimulatedRobot]], robots: dict[str, SimulatedRobot]
) -> None:
    """The response contains braking times and what would end; all five continue."""
    browser, _ = fleet
    begun = _set_going(browser, robots)
    url = browser.action(browser.page(browser.root), LF.StopAll)
    answer = browser.http.post(url, headers={"prefer": "dry-run"})
    assert (answer.status_code, answer.headers["preference-applied"]) == (200, "dry-run")
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    assert {str(each) for each in graph.objects(None, LF.preempts)} == set(begun.values())
    for robot in robots.values():
        robot.watch()
    eventually(lambda: all(len(robot.steps) > 100 for robot in robots.values()), "the simulations going on")
    assert all(robot.speed() > _MOVING_RAD_S for robot in robots.values())
    assert {browser.page(url).one(LF.state) for url in begun.values()} == {LF.running}


def test_stop_of_one_robot_leaves_the_others_alone(
    fleet: tuple[Browser, dict[str, SimulatedRobot]], robots: dict[str, SimulatedRobot]
) -> None:
    browser, _ = fleet
    begun = _set_going(browser, robots)
    Commanded(browser, "panda").do(LF.StopRobot)
    assert robots["panda"].speed() <= RESTING_RAD_S
    states = {name: browser.page(url).one(LF.state) for name, url in begun.items()}
    assert states == dict.fromkeys(begun, LF.running) | {"panda": LF.cancelled}
