"""The driver with real programs of ROS 2: a robot of rclpy behind the bridge from DDS, and one of hiroz on rmw_zenoh.

``make ros-peers`` builds them. What they send is compared with the recording by which units test the driver.
"""

import asyncio
import json
import math
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import pairwise
from typing import Any

import pytest

from driver_contract import check_driver
from linked_fleet_agent.robots.ros2.address import parse_address
from linked_fleet_agent.robots.ros2.cdr import type_hash
from linked_fleet_agent.robots.ros2.graph import CallError, Interface
from linked_fleet_agent.robots.ros2.robot import Ros2Robot
from linked_fleet_agent.robots.ros2.session import RosSession
from linked_fleet_agent.robots.ros2.types import MessageTypes, ServiceType
from ros_peers import URDF, behind_bridge, hiroz_robot, on_humble, on_rmw_zenoh
from ros_recording import RECORDING, recording
from running import eventually

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

TYPES = MessageTypes(preferred="kilted")
LONGEST = 65_536
SIDES = {
    "rmw_zenoh": ("ros2:{}", on_rmw_zenoh),
    "humble": ("ros2:{}?distro=humble", on_humble),
    "bridge": ("ros2dds:{}", behind_bridge),
}


@pytest.fixture(scope="module", params=SIDES)
def address(request: pytest.FixtureRequest) -> Iterator[str]:
    """Yield the address of a robot that is there."""
    address, run = SIDES[request.param]
    with run() as endpoint:
        yield address.format(endpoint)


@pytest.fixture
def session(address: str) -> Iterator[RosSession]:
    where = parse_address(address)
    with closing(RosSession(where.endpoint, 0, "test", type_hash, where.bridge_only)) as session:
        yield session


def offered(session: RosSession, name: str) -> Interface:
    """Return a service or topic that another node has, as soon as it is known."""

    def found() -> Interface | None:
        return next((offer.interface for offer in session.offers() if offer.interface.name == name), None)

    return eventually(found, name)


def call(session: RosSession, name: str, request: dict[str, Any], timeout_s: float = 30.0) -> dict[str, Any]:
    interface = offered(session, name)
    type_: ServiceType = TYPES.service(interface.type)

    async def ask() -> bytes:
        return await asyncio.wait_for(session.call(interface, type_.request.write(request), LONGEST), timeout_s)

    return type_.response.read(asyncio.run(ask()))


def test_the_programs_say_what_they_said_when_they_were_recorded() -> None:
    assert recording() == json.loads(RECORDING.read_text(encoding="utf-8"))


def test_the_driver_fulfils_its_contract() -> None:
    """Over the topic of the controller; by actions, the agent sends whole motions."""
    with behind_bridge() as endpoint:
        robot = Ros2Robot.find("arm", parse_address(f"ros2dds:{endpoint}"))
        check_driver(robot, lambda now_s: time.sleep(0.01), tolerance=1e-3, settle_s=0.6)


def test_the_driver_finds_the_joints_and_reads_them(address: str) -> None:
    with closing(Ros2Robot.find("arm", parse_address(address))) as robot:
        assert robot.describe().urdf == URDF.read_text(encoding="utf-8")
        assert [joint.name for joint in robot.describe().joints] == ["pan", "lift", "finger"]
        eventually(lambda: math.isfinite(robot.read(0.0).positions[0]), "a position")


def test_joint_states_come_a_hundred_times_a_second(session: RosSession) -> None:
    """By the clock of the robot, which stamps them."""
    type_ = TYPES.message("sensor_msgs/msg/JointState")
    box = session.subscribe(Interface("/joint_states", type_.name), LONGEST, most=300)
    stamps: list[float] = []

    def enough() -> bool:
        for arrived in box.fetch():
            assert arrived.payload is not None
            stamp = type_.read(arrived.payload)["header"]["stamp"]
            stamps.append(stamp["sec"] + stamp["nanosec"] * 1e-9)
        return len(stamps) > 200

    eventually(enough, "two hundred joint states")
    gaps = sorted(after - before for before, after in pairwise(stamps))
    assert gaps[len(gaps) // 2] == pytest.approx(0.01, rel=0.2)


def test_a_late_joiner_gets_the_last_message_of_a_latched_topic(session: RosSession) -> None:
    call(session, "/set_lamp", {"data": False})
    call(session, "/set_lamp", {"data": True})
    box = session.subscribe(Interface("/lamp", "std_msgs/msg/Bool"), LONGEST, latched=True)
    arrived = eventually(box.fetch, "the state of the lamp")
    assert [TYPES.message("std_msgs/msg/Bool").read(each.payload or b"") for each in arrived] == [{"data": True}]


def test_a_service_answers(session: RosSession) -> None:
    call(session, "/set_lamp", {"data": False})
    assert call(session, "/set_lamp", {"data": True}) == {"success": True, "message": "switched"}
    assert call(session, "/set_lamp", {"data": True}) == {"success": False, "message": "as it was"}
    assert call(session, "/home", {}) == {"success": True, "message": "on its way"}


def test_a_service_that_does_not_answer_leaves_others_alone(session: RosSession) -> None:
    with pytest.raises(TimeoutError):
        call(session, "/silence", {}, timeout_s=0.5)
    assert call(session, "/home", {})["success"]


def test_a_service_that_nobody_has_is_refused_at_once(session: RosSession) -> None:
    with pytest.raises(CallError, match="no node offers the service /away"):
        asyncio.run(session.call(Interface("/away", "std_srvs/srv/Trigger"), b"", LONGEST))


def test_a_robot_behind_a_bridge_with_a_namespace_is_found_by_it() -> None:
    with behind_bridge(options='namespace: "/arm1", ') as endpoint:
        address = parse_address(f"ros2dds:{endpoint}?namespace=/arm1")
        with closing(Ros2Robot.find("arm", address)) as robot:
            eventually(lambda: math.isfinite(robot.read(0.0).positions[0]), "a position")


def test_both_transports_are_joined_where_both_are() -> None:
    """The bridge is a router too, at which nodes of rmw_zenoh meet."""
    with (
        behind_bridge() as endpoint,
        hiroz_robot(endpoint),
        closing(RosSession(endpoint, 0, "test", type_hash)) as session,
    ):
        offered(session, "/navigate_to_pose/_action/send_goal")
        offered(session, "/fastdds/home")
        assert session.is_bridged
        box = session.subscribe(Interface("/joint_states", "sensor_msgs/msg/JointState"), LONGEST, most=300)
        assert call(session, "/home", {})["success"]
        read = TYPES.message("sensor_msgs/msg/JointState").read
        seen = set[tuple[str, ...]]()

        def both() -> bool:
            seen.update(tuple(read(each.payload or b"")["name"]) for each in box.fetch())
            return len(seen) == 2

        eventually(both, "joint states of both robots, which name their joints in different orders")
