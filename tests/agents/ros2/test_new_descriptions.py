"""A ROS 2 robot that sends another description while its agent runs. Without Zenoh."""

import re
import threading
import time
from types import SimpleNamespace
from typing import cast

import pytest

from descriptions_of_robots import arm
from linked_fleet_agent.robot import NewDescriptionError, RobotFaultError
from linked_fleet_agent.robots.ros2 import new_descriptions
from linked_fleet_agent.robots.ros2.address import parse_address
from linked_fleet_agent.robots.ros2.finding import facts_of
from linked_fleet_agent.robots.ros2.graph import Graph, Mailbox, ReceivedMessage
from linked_fleet_agent.robots.ros2.robot import Ros2Robot
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


def _raised(robot: Ros2Robot, session: Session) -> Exception | None:
    """Read the robot. Return its fault, or that it has described itself anew; None if it is read."""
    try:
        _read(robot, session)
    except (RobotFaultError, NewDescriptionError) as error:
        return error
    return None


def test_another_description_ends_the_run() -> None:
    session = Session()
    robot = _robot(session)
    _deliver(session.descriptions, text(arm(more="<!-- two -->")))
    assert isinstance(eventually(lambda: _raised(robot, session), "an end"), NewDescriptionError)


def test_a_description_that_is_refused_is_a_fault_until_a_good_one_comes() -> None:
    session = Session()
    robot = _robot(session)
    _deliver(session.descriptions, text(arm(attributes=' version="2.0"')))
    fault = eventually(lambda: _raised(robot, session), "the fault")
    assert re.search(r"new description, which is refused: .* version '2\.0'", str(fault))
    assert isinstance(_raised(robot, session), RobotFaultError), "it stays"
    _deliver(session.descriptions, text(arm()))
    eventually(lambda: _raised(robot, session) is None, "the state of the robot with a good description")


class Judge:
    """Judges descriptions as slowly as it is told to: each waits until it is ``allowed``."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.judged, self.allowed = 0, threading.Semaphore(0)
        self.clock_s, self.takes_s = 1000.0, 0.0
        monkeypatch.setattr(new_descriptions, "facts_of", self._judge)
        monkeypatch.setattr(new_descriptions, "time", SimpleNamespace(monotonic=lambda: self.clock_s))

    def _judge(self, name: str, arrived: ReceivedMessage) -> None:
        self.judged += 1
        assert self.allowed.acquire(timeout=60)
        self.clock_s += self.takes_s
        raise UrdfError(f"number {self.judged} is no robot")


@pytest.fixture
def judge(monkeypatch: pytest.MonkeyPatch) -> Judge:
    return Judge(monkeypatch)


def test_the_robot_is_read_while_a_description_is_judged(judge: Judge) -> None:
    session = Session()
    robot = _robot(session)
    _deliver(session.descriptions, text(arm(more="<!-- two -->")))
    for _ in range(3):
        assert _read(robot, session) == (0.5, -0.5)
    eventually(lambda: judge.judged, "the thread")
    assert _read(robot, session) == (0.5, -0.5)
    judge.allowed.release()
    assert "number 1 is no robot" in str(eventually(lambda: _raised(robot, session), "the fault"))


def test_a_flood_of_descriptions_costs_little_of_the_time(judge: Judge) -> None:
    """One that takes a second is followed by fifty without another, and one is judged at a time."""
    session = Session()
    robot = _robot(session)
    judge.takes_s = 1.0
    for number in range(1, 4):
        for flood in range(20):
            _deliver(session.descriptions, text(arm(more=f"<!-- {number} {flood} -->")))
            _raised(robot, session)
        judge.allowed.release()
        eventually(lambda n=number: f"number {n} " in str(_raised(robot, session)), "the fault")
        judge.clock_s += 49.0
        _deliver(session.descriptions, text(arm(more="<!-- early -->")))
        _raised(robot, session)
        assert judge.judged == number
        judge.clock_s += 2.0


def test_the_own_description_counts_at_once_and_while_another_is_judged(judge: Judge) -> None:
    session = Session()
    robot = _robot(session)
    judge.takes_s = 100.0
    _deliver(session.descriptions, text(arm(more="<!-- two -->")))
    judge.allowed.release()
    eventually(lambda: _raised(robot, session), "the fault")
    _deliver(session.descriptions, text(arm()))
    assert _read(robot, session) == (0.5, -0.5)
    judge.clock_s += 1e4
    _deliver(session.descriptions, text(arm(more="<!-- three -->")))
    _read(robot, session)
    eventually(lambda: judge.judged == 2, "the thread")
    _deliver(session.descriptions, text(arm()))
    _read(robot, session)
    judge.allowed.release()
    eventually(lambda: judge.clock_s > 1.1e4, "the judgement")
    for _ in range(10):
        assert _read(robot, session) == (0.5, -0.5), "its own one came after the refused one"
        time.sleep(0)


def test_bytes_that_are_no_description_are_ignored(caplog: pytest.LogCaptureFixture) -> None:
    session = Session()
    robot = _robot(session)
    _deliver(session.descriptions, b"\xff")
    eventually(lambda: _raised(robot, session) is None and robot.bad_messages, "it is counted")
    assert _read(robot, session) == (0.5, -0.5)
    assert any("no description is ignored" in message for message in caplog.messages)


def test_names_of_joint_states_are_those_of_the_description() -> None:
    """White space around a name has no meaning, wherever it stands."""
    session = Session()
    robot = _robot(session)
    _deliver(session.states, joint_state(["j1 ", " j2"], [0.25, 0.75]))
    assert robot.read(0.0).positions == (0.25, 0.75)
