"""Jogging of a simulated arm by streams: it follows, keeps clear of things, and says why it is slow."""

import contextlib
import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from browser import LF, Browser
from linked_fleet_state.xml import rotation
from running import eventually
from scene_client import contents, crate, placement, put_object, put_robot
from simulated_robots import SimulatedRobot, angle_between, simulated
from small_fleet import Place, live
from virtual.client import WebSocket
from virtual.loop import VirtualLoop, current

pytestmark = pytest.mark.virtual
PERIOD_S = 1 / 30
JSON = {"content-type": "application/json", "accept": "application/json"}
PAN = "shoulder_pan_joint"
X, Y = np.array((1.0, 0.0, 0.0)), np.array((0.0, 1.0, 0.0))


class Jogger:
    """A client that jogs a robot by a stream."""

    def __init__(self, loop: VirtualLoop, url: str) -> None:
        self._loop = loop
        self.socket = WebSocket(loop, url.replace("http", "ws", 1), {}, "lf.drive")
        self.told: dict[str, Any] = {}
        self.reasons, self.shares = list[str](), list[float]()
        self.hear(5)

    def hear(self, wait_s: float = 0.0005) -> None:
        """Take the messages that have come, the first of which may be waited for."""
        with contextlib.suppress(TimeoutError):
            while True:
                said = json.loads(self.socket.recv(wait_s))
                values = {**self.told.get("values", {}), **said.get("values", {})}
                self.told, wait_s = {**said, "values": values}, 0.0005
                self.reasons.append(said["limitedBecause"])
                self.shares.append(said["speedScale"])

    def jog(self, seconds: float, **given: Any) -> None:
        end_s = self._loop.time() + seconds
        while self._loop.time() < end_s:
            self.hear()
            self.socket.send(json.dumps({"seen": self.told["time"], "input": given}))
            self._loop.run_for(PERIOD_S)


class Cell:
    """A gateway and a simulated UR5."""

    def __init__(self, loop: VirtualLoop, place: Place, browser: Browser, robot: SimulatedRobot) -> None:
        self.loop, self.browser, self.robot = loop, browser, robot
        self.url = place.root + "ur5/"

    def action(self, name: str) -> str:
        return f"{self.url}jogging/actions/{name}"

    def open(self, action: str) -> Jogger:
        return Jogger(self.loop, self.action(action))

    def tip(self) -> tuple[Any, Any]:
        """Return position and orientation of the tool, as it stands in MuJoCo, in the frame of the root."""
        return self.robot.pose("tool0")

    def in_world(self, position: Any) -> tuple[float, float, float]:
        """Return where something is in the world, in which the robot is turned by a quarter."""
        x, y, z = position
        return -y, x, z

    def post(self, action: str, **given: Any) -> dict[str, Any]:
        answer = self.browser.http.post(self.action(action), json=given, headers=JSON | {"prefer": "wait=5"})
        assert answer.status_code < 300, answer.text
        found: dict[str, Any] = self.browser.http.get(answer.headers["location"], headers=JSON).json()
        return found


def turn(quaternion: Any) -> Any:
    """Return the matrix of a quaternion x y z w."""
    return np.array(rotation(tuple(quaternion.tolist())))


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    loop = current()
    assert loop is not None
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), simulated(place.zenoh, "ur5") as robots:
        live(browser, "ur5")
        put_robot(browser, "ur5", 0, 0, 0, math.pi / 2)
        made = Cell(loop, place, browser, robots["ur5"])
        eventually(lambda: browser.http.get(made.action("jogHand")).status_code == 200, "the action")
        yield made


@pytest.fixture(autouse=True)
def empty(cell: Cell) -> None:
    """Begin without things, and with a robot that stands."""
    for each in contents(cell.browser):
        assert cell.browser.http.delete(each).status_code == 204
    eventually(lambda: cell.robot.speed() < 1e-3, "a standstill")


def test_joints_follow_the_samples(cell: Cell) -> None:
    before = cell.robot.positions()[PAN]
    jogger = cell.open("jogJoints")
    jogger.jog(1.0, velocities={PAN: 0.3})
    jogger.jog(0.5)
    assert cell.robot.positions()[PAN] - before == pytest.approx(0.3, abs=0.03)
    assert set(jogger.reasons) == {""}
    assert jogger.told["applied"] > 30
    assert jogger.told["dropped"]["late"] == 0


@pytest.mark.parametrize("frame", ["hand", "root", "world"])
def test_the_hand_keeps_a_straight_line_in_each_frame(cell: Cell, frame: str) -> None:
    start, turned = cell.tip()
    jogger = cell.open("jogHand")
    jogger.jog(2.0, linear={"y": 0.1}, frame=frame)
    jogger.jog(0.5)
    end, after = cell.tip()
    axis = {"hand": turn(turned) @ Y, "root": Y, "world": X}[frame]
    along = float((end - start) @ axis)
    assert along == pytest.approx(0.2, abs=0.01)
    assert float(np.linalg.norm(end - start - along * axis)) < 0.002
    assert angle_between(turned, after) < 0.01
    assert jogger.told["dropped"]["late"] == 0
    jogger.jog(2.0, linear={"y": -0.1}, frame=frame)


def test_the_hand_turns_about_its_origin(cell: Cell) -> None:
    start, turned = cell.tip()
    jogger = cell.open("jogHand")
    jogger.jog(1.0, angular={"z": 0.5})
    jogger.jog(0.5)
    end, after = cell.tip()
    assert float(np.linalg.norm(end - start)) < 0.003
    assert angle_between(turned, after) == pytest.approx(0.5, abs=0.04)
    jogger.jog(1.0, angular={"z": -0.5})


def test_the_hand_slows_down_before_a_crate_and_says_why(cell: Cell) -> None:
    start, _ = cell.tip()
    x, y, z = cell.in_world(start)
    put_object(cell.browser, crate("Crate", x - 0.5, y, z))
    jogger = cell.open("jogHand")
    eventually(lambda: jogger.jog(0.1) or "prepared" not in jogger.told["limitedBecause"], "the shapes")
    jogger.jog(6.0, linear={"x": -0.2}, frame="world")
    assert "would meet an obstacle" in jogger.told["limitedBecause"]
    assert jogger.told["speedScale"] < 0.2
    gone = start - cell.tip()[0]
    assert 0.05 < float(np.linalg.norm(gone)) < 0.35
    assert cell.robot.speed() < 0.01
    jogger.jog(1.0, linear={"x": 0.2}, frame="world")
    assert jogger.told["limitedBecause"] == ""
    back = start - cell.tip()[0]
    assert float(np.linalg.norm(back)) < float(np.linalg.norm(gone)) - 0.1


def test_a_stretched_arm_slows_down_and_no_joint_races(cell: Cell) -> None:
    jogger = cell.open("jogHand")
    cell.robot.watch()
    jogger.jog(6.0, linear={"z": 0.3}, frame="world")
    assert any("singularity" in each or "highest speed" in each for each in jogger.reasons)
    assert min(jogger.shares) < 0.5
    cell.robot.check_limits()
    jogger.jog(2.0, linear={"z": -0.2}, frame="world")
    assert jogger.told["speedScale"] > 0.5


def test_a_single_request_moves_the_hand_for_its_time(cell: Cell) -> None:
    start, _ = cell.tip()
    ended = cell.post("jogHand", linear={"y": 0.1}, frame="root", duration=0.5)
    assert ended["state"].endswith("succeeded"), ended
    way = cell.tip()[0] - start
    assert way[1] == pytest.approx(0.05, abs=0.015)
    refused = cell.browser.http.post(cell.action("jogHand"), json={"link": "nothing"}, headers=JSON)
    assert refused.status_code == 422


def test_the_action_is_described_with_its_links_and_frames(cell: Cell) -> None:
    page = cell.browser.page(cell.action("jogHand"))
    assert LF.JogHand in page.types
    assert str(page.one(LF.streamProtocol)) == "lf.drive"
    td = cell.browser.http.get(cell.url + "jogging", headers={"accept": "application/td+json"}).json()
    given = td["actions"]["jogHand"]["input"]["properties"]
    assert given["link"]["default"] == "tool0"
    assert given["frame"]["enum"] == ["hand", "root", "world"]


def test_without_a_placement_the_axes_of_the_world_are_unknown(cell: Cell) -> None:
    assert cell.browser.http.delete(placement(cell.browser, "ur5")).status_code == 204
    try:
        start, _ = cell.tip()
        jogger = cell.open("jogHand")
        jogger.jog(0.5, linear={"y": 0.1}, frame="world")
        assert jogger.told["limitedBecause"] == "ur5 has no placement, so the axes of the world are unknown"
        assert float(np.linalg.norm(cell.tip()[0] - start)) < 0.001
        refused = cell.browser.http.post(
            cell.action("jogHand"), json={"linear": {"y": 0.1}, "frame": "world"}, headers=JSON
        )
        assert refused.status_code == 409
    finally:
        put_robot(cell.browser, "ur5", 0, 0, 0, math.pi / 2)
