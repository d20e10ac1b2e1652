"""Agents and gateways come, go and are killed; the fleet stays readable and comes back (real processes)."""

import json
import signal
import socket
from pathlib import Path

import pytest
from actor import KEYS, stage
from browser import LF, ROS, SPATIAL, Browser
from running import Process, eventually, process
from small_fleet import Place, live, move, number, offline, property_page

pytestmark = pytest.mark.processes
_JOINT = "wrist_3_joint"


def test_killed_agent_stays_readable_and_comes_back(tmp_path: Path) -> None:
    """SIGKILL: offline with the time on robot, joint, link and property; values stay; actions 503; then live again."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser):
        with place.ur5() as agent:
            live(browser, "ur5")
            # Zenoh would share memory with each neighbour here, and keep it when that is killed.
            assert ".zenoh" not in gateway.mapped + agent.mapped
            action = browser.action(browser.part("ur5", _JOINT), LF.Rotate)
            answer = move(browser, action, 0.4, prefer="wait=30")
            assert answer.status_code == 204, answer.text
            agent.send(signal.SIGKILL)
            robot = offline(browser, "ur5")
        pages = [robot, browser.part("ur5", _JOINT), browser.part("ur5", "wrist_3_link")]
        pages.append(rotation := property_page(browser, "ur5", _JOINT, ROS.rotation))
        pages.append(property_page(browser, "ur5", "wrist_3_link", LF.pose))
        pages.append(browser.page(str(robot.one(LF.jointState))))
        for page in pages:
            assert page.one(LF.presence) == LF.offline, page.url
            assert page.graph.value(page.iri, LF.lastSeen) not in (None, LF.unknown), page.url
        assert number(rotation, SPATIAL.rotationAngle) == pytest.approx(0.4, abs=0.01)
        refused = move(browser, action, 0.1)
        assert (refused.status_code, refused.headers["content-type"]) == (503, "application/problem+json")
        assert "offline" in refused.json()["detail"]
        with place.ur5():
            back = live(browser, "ur5")
            assert (back.iri, LF.lastSeen, None) not in back.graph
            answer = move(browser, action, 0.2, prefer="wait=30")
            assert answer.status_code == 204, answer.text
            angle = number(property_page(browser, "ur5", _JOINT, ROS.rotation), SPATIAL.rotationAngle)
            assert angle == pytest.approx(0.2, abs=0.01)


def test_terminated_agent_and_gateway_end_cleanly(tmp_path: Path) -> None:
    """SIGTERM: the robot goes offline, agent and gateway end with 0 and without a traceback."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser):
        with place.ur5() as agent:
            live(browser, "ur5")
            agent.send(signal.SIGTERM)
            offline(browser, "ur5")
            assert agent.ended() == 0
        gateway.send(signal.SIGTERM)
        assert gateway.ended() == 0
        assert "Traceback" not in agent.output + gateway.output


def test_gateway_killed_in_a_motion(tmp_path: Path) -> None:
    """The agent fails the motion and holds; the gateway, started again on its ports, finds the robot at that place."""
    place, observers = Place(tmp_path / "a"), Place(tmp_path / "b")
    told: list[dict[str, object]] = []
    with place.ur5("--listen", observers.zenoh), stage(observers.zenoh) as observer:
        progress = observer.declare_subscriber(
            KEYS.robot("ur5", "progress"), lambda sample: told.append(json.loads(sample.payload.to_bytes()))
        )
        with place.gateway() as (gateway, browser):
            live(browser, "ur5")
            action = browser.action(browser.part("ur5", "shoulder_pan_joint"), LF.Rotate)
            start = number(property_page(browser, "ur5", "shoulder_pan_joint", ROS.rotation), SPATIAL.rotationAngle)
            answer = move(browser, action, 6.2)
            assert answer.status_code == 204, answer.text

            def moved() -> bool:
                page = property_page(browser, "ur5", "shoulder_pan_joint", ROS.rotation)
                return abs(number(page, SPATIAL.rotationAngle) - start) > 0.2

            eventually(moved, "a motion under way")
            gateway.send(signal.SIGKILL)
            ends = eventually(lambda: [each for each in told if each["state"] != "running"], "the end of the motion")
            assert [each["state"] for each in ends] == ["failed"]
            assert "gateway" in str(ends[0]["reason"])
        with place.gateway() as (_, browser):
            first = live(browser, "ur5")
            held = number(property_page(browser, "ur5", "shoulder_pan_joint", ROS.rotation), SPATIAL.rotationAngle)
            assert 0.2 < abs(held - start) < 6
            later = live(browser, "ur5")
            assert first.iri == later.iri
            again = number(property_page(browser, "ur5", "shoulder_pan_joint", ROS.rotation), SPATIAL.rotationAngle)
            assert again == pytest.approx(held, abs=0.01)
            assert move(browser, action, start, prefer="wait=30").status_code == 204
        progress.undeclare()


def test_second_agent_of_a_name_refuses_to_start(tmp_path: Path) -> None:
    """It says why and ends with an error; the first goes on, and started beside a token that is nobody's run."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), stage(place.zenoh) as session:
        token = session.liveliness().declare_token("fleet/robot/ur5/presence/whoever")
        with place.ur5() as first:
            _refused_beside(place, gateway, browser, first)
        token.undeclare()


def _refused_beside(place: Place, gateway: Process, browser: Browser, first: Process) -> None:
    live(browser, "ur5")
    with place.ur5("--lease-ms", "300") as second:
        assert second.ended() == 3
        assert "'ur5' is taken" in second.output
        assert "Traceback" not in second.output
    assert gateway.output.count("robot ur5: appeared") == 1
    assert "vanished" not in gateway.output
    live(browser, "ur5")
    action = browser.action(browser.part("ur5", _JOINT), LF.Rotate)
    assert move(browser, action, 0.1, prefer="wait=30").status_code == 204
    assert "Traceback" not in first.output


@pytest.mark.parametrize("taken", ["http", "zenoh"])
def test_taken_port_is_one_line(tmp_path: Path, taken: str) -> None:
    """Whichever port it is: one line that names it, exit code 1."""
    place = Place(tmp_path)
    number = place.port if taken == "http" else int(place.zenoh.rpartition(":")[2])
    with socket.create_server(("127.0.0.1", number)), process(*place.command()) as gateway:
        assert gateway.ended() == 1
    (line,) = gateway.lines
    assert line.startswith("gateway: ")
    assert str(number) in line


def test_two_gateways_started_at_once(tmp_path: Path) -> None:
    """Of two gateways on one HTTP port exactly one serves, however close their starts are."""
    place, other = Place(tmp_path / "a"), Place(tmp_path / "b")
    other.port = place.port
    with process(*place.command()) as one, process(*other.command()) as two:
        refused = eventually(
            lambda: next((each for each in (one, two) if "cannot listen" in each.output), None), "one gives up"
        )
        assert refused.ended() == 1
        (two if refused is one else one).said("serving")
