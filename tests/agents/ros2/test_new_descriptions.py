"""A ROS 2 robot that sends another description while its agent runs. Without Zenoh."""

import time
from contextlib import suppress
from types import SimpleNamespace
from typing import cast

import pytest

from descriptions_of_robots import arm
from linked_fleet_agent.robot import NewDescriptionError, RobotFaultError
from linked_fleet_agent.robots.ros2 import robot as robot_module
from linked_fleet_agent.robots.ros2.address import parse_address
from linked_fleet_agent.robots.ros2.graph import Graph, Mailbox, ReceivedMessage
from linked_fleet_agent.robots.ros2.robot import Ros2Robot, facts_of
from linked_fleet_agent.urdf import UrdfError
from ros2_robot import joint_state, text
from running import eventually


class Session:
    """The topics of a robot: its description and its joint states."""

    def __init__(self) -> None:
        self.descriptions, self.states = Mailbox(100_000, 4), Mailbox(100_000, 4)

    def subscribe(self, *_: object) -> Mailbox:
        return self.states

    def outlet(self, *_: object) -> None:
        """Take no commands."""


def _message(payload: bytes) -> ReceivedMessage:
    return ReceivedMessage(payload, time.monotonic())


def _deliver(box: Mailbox, payload: bytes) -> None:
    box.put(payload)


def _robot(session: Session) -> Ros2Robot:
    facts = facts_of("r", _message(text(arm())))
    return Ros2Robot("r", parse_address("ros2:tcp/127.0.0.1:7447"), facts, cast(Graph, session), session.descriptions)


def _read(robot: Ros2Robot, session: Session) -> tuple[float, ...]:
    _deliver(session.states, joint_state(["j1", "j2"], [0.5, -0.5]))
    return robot.read(0.0).positions


def test_a_description_that_is_sent_again_changes_nothing() -> None:
    session = Session()
    robot = _robot(session)
    _deliver(session.descriptions, text(arm()))
    assert _read(robot, session) == (0.5, -0.5)


def test_another_description_ends_the_run() -> None:
    session = Session()
    robot = _robot(session)
    _deliver(session.descriptions, text(arm(more="<!-- two -->")))
    with pytest.raises(NewDescriptionError):
        _read(robot, session)


def test_a_description_that_is_refused_is_a_fault_until_a_good_one_comes() -> None:
    session = Session()
    robot = _robot(session)
    _deliver(session.descriptions, text(arm(attributes=' version="2.0"')))
    for _ in range(2):
        with pytest.raises(RobotFaultError, match=r"new description, which is refused: .* version '2\.0'"):
            _read(robot, session)
    _deliver(session.descriptions, text(arm()))

    def is_read() -> bool:
        with suppress(RobotFaultError):
            return _read(robot, session) == (0.5, -0.5)
        return False

    eventually(is_read, "the state of the robot with a good description")


def test_a_flood_of_descriptions_costs_little_of_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that takes a second is followed by fifty without another."""
    session, judged, later_s = Session(), list[float](), [0.0]

    def slowly(name: str, arrived: ReceivedMessage) -> None:
        judged.append(later_s[0])
        later_s[0] += 1.0
        raise UrdfError("it is no robot")

    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + later_s[0], time_ns=time.time_ns)
    robot = _robot(session)
    monkeypatch.setattr(robot_module, "facts_of", slowly)
    monkeypatch.setattr(robot_module, "time", clock)
    for number in range(1100):
        _deliver(session.descriptions, text(arm(more=f"<!-- {number} -->")))
        with pytest.raises(RobotFaultError, match="it is no robot"):
            _read(robot, session)
        later_s[0] += 0.1
    assert [round(each) for each in judged] == [0, 51, 102]


def test_the_good_description_counts_at_once_after_one_that_took_long(monkeypatch: pytest.MonkeyPatch) -> None:
    session, later_s = Session(), [0.0]

    def slowly(name: str, arrived: ReceivedMessage) -> None:
        later_s[0] += 100.0
        raise UrdfError("it is no robot")

    robot = _robot(session)
    monkeypatch.setattr(robot_module, "facts_of", slowly)
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + later_s[0], time_ns=time.time_ns)
    monkeypatch.setattr(robot_module, "time", clock)
    _deliver(session.descriptions, text(arm(more="<!-- two -->")))
    with pytest.raises(RobotFaultError, match="it is no robot"):
        _read(robot, session)
    _deliver(session.descriptions, text(arm()))
    session.states.put(joint_state(["j1", "j2"], [0.5, -0.5]), clock.monotonic())
    assert robot.read(0.0).positions == (0.5, -0.5)


def test_bytes_that_are_no_description_are_ignored(caplog: pytest.LogCaptureFixture) -> None:
    session = Session()
    robot = _robot(session)
    _deliver(session.descriptions, b"\xff")
    assert _read(robot, session) == (0.5, -0.5)
    assert any("no description is ignored" in message for message in caplog.messages)


def test_names_of_joint_states_are_those_of_the_description() -> None:
    """White space around a name has no meaning, wherever it stands."""
    session = Session()
    robot = _robot(session)
    _deliver(session.states, joint_state(["j1 ", " j2"], [0.25, 0.75]))
    assert robot.read(0.0).positions == (0.25, 0.75)
