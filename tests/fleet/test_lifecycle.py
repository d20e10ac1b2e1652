"""Agents and gateways are killed; the fleet stays readable and comes back."""

import asyncio
import signal
from pathlib import Path

import pytest

from browser import LF, ROS, SPATIAL
from fake_robots import KEYS
from linked_fleet_agent.wire.codec import decode
from linked_fleet_agent.wire.messages import Progress
from linked_fleet_state.events import Payload
from running import eventually
from small_fleet import Place, live, move, number, offline, property_page
from virtual.processes import gateway_session

pytestmark = pytest.mark.virtual
_JOINT = "wrist_3_joint"


def test_killed_agent_stays_readable_and_comes_back(tmp_path: Path) -> None:
    """SIGKILL: offline with the time on robot, joint, link and property; values stay; actions 503; then live again."""
    place = Place(tmp_path)
    with place.gateway() as (_, browser):
        with place.ur5() as agent:
            live(browser, "ur5")
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


def test_gateway_killed_in_a_motion(tmp_path: Path) -> None:
    """The agent fails the motion and holds; the gateway, restarted on its ports, finds the robot at that position."""
    place = Place(tmp_path)
    told: list[Progress] = []

    def take(_: str, payload: Payload) -> None:
        assert isinstance(payload, bytes)
        told.append(decode(payload, Progress))

    async def listen() -> None:
        await (await gateway_session(place.zenoh)).subscribe(KEYS.robot("ur5", "progress"), 2**20, take)

    asyncio.run(listen())
    with place.ur5():
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
            ends = eventually(lambda: [each for each in told if each.state != "running"], "the end of the motion")
            assert {each.state for each in ends} == {"failed"}
            assert "gateway" in ends[0].reason
        with place.gateway() as (_, browser):
            first = live(browser, "ur5")
            held = number(property_page(browser, "ur5", "shoulder_pan_joint", ROS.rotation), SPATIAL.rotationAngle)
            assert 0.2 < abs(held - start) < 6
            later = live(browser, "ur5")
            assert first.iri == later.iri
            again = number(property_page(browser, "ur5", "shoulder_pan_joint", ROS.rotation), SPATIAL.rotationAngle)
            assert again == pytest.approx(held, abs=0.01)
            assert move(browser, action, start, prefer="wait=30").status_code == 204
