"""Demonstrations end by a stop or a command, say so, and only restart when a person requests it."""

import logging
import os

import pytest

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.motion import Sway
from linked_fleet_agent.robots.catalogue import load
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import Accepted, Command, Description, Move, Stop

PAN = "shoulder_pan_joint"


class Bench:
    """A simulated arm that sways, on the test's own clock; also stands in for the link."""

    gateway_present, arrivals = True, 1

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000
        self.positions: tuple[float, ...] = ()
        self.agent = Agent("ur5", load("ur5", "ur5"), sways=[Sway(PAN)], monotonic_ns=lambda: self.now_ns)
        self.run(1.0)

    def watch_gateways(self, period_s: float) -> None:
        """Do nothing: a gateway is always present."""

    def publish_state(self, payload: bytes) -> None:
        self.positions = codec.decode_state(payload).positions

    def publish_condition(self, payload: bytes) -> None:
        """Ignore it."""

    publish_values = publish_event = publish_condition

    def publish_progress(self, payload: bytes, final: bool) -> None:
        """Do nothing: nobody listens."""

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.now_ns += 10_000_000
            self.agent.tick(self)

    def pan(self) -> float:
        return self.positions[codec.decode(self.agent.description, Description).joints.index(PAN)]

    def stop(self, stop_id: str, **more: object) -> None:
        payload = codec.encode(Stop(version=1, id=stop_id, **more))  # type: ignore[arg-type]
        assert isinstance(codec.decode_reply(self.agent.handle_stop(payload)), Accepted)

    def move(self, command_id: str, joint: str, rehearsal: bool = False) -> None:
        command = Command(
            version=1,
            id=command_id,
            incarnation=self.agent.incarnation,
            seen_ns=self.now_ns,
            time_to_live_ns=1_000_000_000,
            motion=Move({joint: 1.0}),
            rehearsal=rehearsal,
        )
        assert isinstance(codec.decode_reply(self.agent.handle(codec.encode(command))), Accepted)


def test_a_stop_holds_until_a_person_begins_the_demonstration_anew(caplog: pytest.LogCaptureFixture) -> None:
    """It holds however long that takes; the log names the command to restart, and the next stop ends it again."""
    bench = Bench()
    for turn in (1, 2):
        bench.stop(f"s{turn}")
        assert f"the demonstration of {PAN} has ended; to restart it: kill -USR1 {os.getpid()}" in caplog.text
        bench.run(3.0)
        caplog.clear()
        stood = bench.pan()
        bench.run(20.0)
        assert bench.pan() == pytest.approx(stood, abs=1e-4)
        assert caplog.text == ""
        bench.agent.demonstration.restart()
        assert f"the demonstration of {PAN} restarts" in caplog.text
        bench.run(1.0)
        assert abs(bench.pan() - stood) > 0.01


def test_commands_of_other_joints_do_not_end_a_demonstration(caplog: pytest.LogCaptureFixture) -> None:
    """Stops and commands of other joints, and rehearsals, do not end it; a command of its joint does."""
    bench = Bench()
    bench.stop("s", joints=("elbow_joint",))
    bench.stop("t", rehearsal=True)
    bench.run(0.1)
    bench.move("a", "elbow_joint")
    bench.move("b", PAN, rehearsal=True)
    assert "demonstration" not in caplog.text
    bench.move("c", PAN)
    assert f"the demonstration of {PAN} has ended" in caplog.text


def test_there_is_nothing_to_begin_while_it_runs_or_while_a_command_moves_the_joint(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Bench()
    with caplog.at_level(logging.INFO):
        bench.agent.demonstration.restart()
        bench.move("a", PAN)
        bench.agent.demonstration.restart()
    assert caplog.text.count("no demonstration can be restarted") == 2
