"""What a gripper holds, at two gateways and after their end: all say the same."""

import signal
from pathlib import Path
from typing import Any

import httpx
import pytest
import rdflib

from browser import LF, Browser
from linked_fleet_agent.components import Force, Grasped, Gripper, Holding, Width, action, value
from linked_fleet_agent.robots.of_components import RobotOfComponents
from running import eventually, process
from scene_client import put_robot
from small_fleet import Place, live
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual
URDF = """<robot name="gripper"><link name="hand"/><link name="finger"/><joint name="slide" type="prismatic">
  <parent link="hand"/><child link="finger"/><limit lower="0" upper="0.08" velocity="0.1" effort="70"/></joint>
  </robot>"""
M = "http://qudt.org/vocab/unit/M"
CUP: dict[str, Any] = {
    "title": "cup", "position": {"x": 0, "y": 0, "z": 0.1, "unit": M},
    "geometry": {"form": str(LF.Sphere), "radius": {"value": 0.02, "unit": M}},
}  # fmt: skip


class Fingers(Gripper, blocking=False, rate_hz=100):
    """Fingers that close and open at once, around what is always between them."""

    name, push = "gripper", 0.0

    @value
    def width(self) -> Width:
        return 0.03 if self.push else 0.08

    @value
    def force(self) -> Force:
        return self.push

    @value
    def holding(self) -> Holding:
        return self.push > 0.0

    @action(moves=["slide"])
    async def grasp(self, width: Width = 0.0, force: Force = 20.0) -> Grasped:
        """Hold what is there."""
        self.push = force
        return Grasped(self.width, True, self.push)

    @action(moves=["slide"])
    async def open(self, width: Width = 0.08) -> None:
        """Hold nothing."""
        self.push = 0.0


def holder(place: Place, path: str) -> str:
    """Return the path of what holds an object, empty for nothing."""
    answer = httpx.get(place.root + path, headers={"accept": "text/turtle"}, timeout=20).raise_for_status()
    graph = rdflib.Graph().parse(data=answer.text, format="turtle", publicID=place.root)
    return "".join(httpx.URL(str(each)).path for each in graph.objects(None, LF.heldBy))


def grip(place: Place, action: str, body: dict[str, Any]) -> None:
    url = f"{place.root}gripper/gripper/actions/{action}"
    answer = httpx.post(url, json=body, headers={"prefer": "wait=10"}, timeout=20)
    assert answer.status_code in (201, 204), answer.text


def test_what_a_gripper_holds_is_known_at_all_gateways_and_outlives_them(tmp_path: Path) -> None:
    one = Place(tmp_path)
    other, third, fingers = Place(tmp_path, zenoh=one.zenoh), Place(tmp_path, zenoh=one.zenoh), Fingers()
    robot = RobotOfComponents("Gripper", fingers, urdf=URDF, measure=lambda: [fingers.width])
    with process(*one.command()) as first, process(*other.command()) as second:
        first.said("serving")
        second.said("serving")
        with serving_robot(one.zenoh, "gripper", robot):
            browser = Browser(one.root)
            live(browser, "gripper")
            put_robot(browser, "gripper", 0.1, 0, 0)
            url = f"{one.root}gripper/gripper"
            eventually(lambda: httpx.get(url, timeout=20).status_code == 200, "the gripper")
            added = httpx.post(f"{one.root}world/objects", json=CUP, timeout=20).headers["location"]
            path = httpx.URL(added).path.lstrip("/")
            grip(one, "grasp", {"object": added})
            for place in (one, other):
                eventually(lambda: holder(place, path) == "/gripper/hand", "both gateways know what it holds")  # noqa: B023
            browser.close()
            for each in (first, second):
                each.send(signal.SIGKILL)
            with process(*third.command()) as late:
                late.said("serving")
                assert holder(third, path) in ("", "/gripper/hand"), "the robot may not have described itself yet"
                eventually(lambda: holder(third, path) == "/gripper/hand", "a new gateway knows it too")
                eventually(
                    lambda: httpx.get(f"{third.root}gripper/gripper", timeout=20).status_code == 200, "it is back"
                )
                grip(third, "open", {})
                eventually(lambda: holder(third, path) == "", "it is let go")
