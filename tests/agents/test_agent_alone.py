"""What an agent accepts, refuses, stops and reports, without a network and on the test's own clock."""

import asyncio
import json
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from component_agent import Memory
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.motion import Sway
from linked_fleet_agent.robot import Facts, JointFacts, Limits, NewDescriptionError, Reading, RobotFaultError
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import (
    Accepted,
    Command,
    Expectation,
    Follow,
    Move,
    Progress,
    Refused,
    Reply,
    Stop,
)
from linked_fleet_agent.wire.transport import GATEWAY_LEASE_MS

_URDF = """<robot name="brittle"><link name="base"/><link name="a"/><link name="b"/>
  <joint name="arm" type="continuous"><parent link="base"/><child link="a"/></joint>
  <joint name="wheel" type="continuous"><parent link="base"/><child link="b"/></joint></robot>"""


class BreakableRobot:
    """A robot with two joints that reach every setpoint at once, and that can be broken."""

    broken = unstoppable = short = anew = False
    effort: Any = math.nan

    def __init__(self, limits: Limits = Limits(), arm: float = 0.0) -> None:  # noqa: B008 - it is frozen
        self.positions = {"arm": arm, "wheel": 0.0}
        self.stops = 0
        self._joints = (JointFacts("arm", limits=limits), JointFacts("wheel", continuous=True))

    def describe(self) -> Facts:
        return Facts("brittle", _URDF, self._joints)

    def read(self, now_s: float) -> Reading:
        if self.broken:
            raise RobotFaultError("cable out")
        if self.anew:
            raise NewDescriptionError("it describes itself anew")
        return Reading(tuple(self.positions.values()), (math.nan,) * (1 if self.short else 2), (self.effort,) * 2)

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        self.positions |= setpoints
        return setpoints

    def stop(self) -> None:
        self.stops += 1
        if self.unstoppable:
            raise RobotFaultError("brake gone")

    def close(self) -> None:
        pass


class Bench:
    """An agent with a brittle robot, a link without a network and a clock."""

    def __init__(self, sways: Iterable[Sway] = (), **robot: Any) -> None:
        self.now_ns = 1_000_000_000
        self.robot, self.link = BreakableRobot(**robot), Memory()
        self.suspended_ns = 0
        self.agent = Agent(
            "b", self.robot, sways=sways, monotonic_ns=lambda: self.now_ns,
            elapsed_ns=lambda: self.now_ns + self.suspended_ns,
        )  # fmt: skip
        self.tick()

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.now_ns += 10_000_000
            self.agent.tick(self.link)

    def wait(self, seconds: int) -> None:
        """Let time pass in steps of 1 s, which an agent does not take for a pause."""
        for _ in range(seconds):
            self.now_ns += 1_000_000_000
            self.agent.tick(self.link)

    def command(
        self, command_id: str, motion: Move | Follow | None = None, seen_ns: int | None = None, **more: Any
    ) -> Reply:
        asked = Command(
            version=1,
            id=command_id,
            incarnation=self.agent.incarnation,
            seen_ns=self.link.states[-1].monotonic_ns if seen_ns is None else seen_ns,
            time_to_live_ns=60_000_000_000,
            motion=motion or Move({"arm": 1.0}),
            **more,
        )
        return codec.decode_reply(self.agent.handle(codec.encode(asked)))

    def stop(self, stop_id: str, **more: Any) -> Reply:
        return codec.decode_reply(self.agent.handle_stop(codec.encode(Stop(version=1, id=stop_id, **more))))

    def end(self, command_id: str) -> Progress:
        return [progress for progress in self.link.progress if progress.id == command_id][-1]


def _code(reply: Reply) -> str:
    return reply.code if isinstance(reply, Refused) else "accepted"


def test_a_driver_fault_is_survived_and_nothing_is_invented(caplog: pytest.LogCaptureFixture) -> None:
    """Values become NaN, the motion fails, commands are refused with the fault; afterwards everything works again."""
    bench = Bench()
    assert _code(bench.command("a")) == "accepted"
    bench.robot.broken = True
    bench.tick()
    assert math.isnan(bench.link.states[-1].positions[0])
    assert [(p.id, p.state) for p in bench.link.progress] == [("a", "running"), ("a", "failed")]
    refused = bench.command("b")
    assert isinstance(refused, Refused)
    assert (refused.code, "cable out" in refused.reason) == ("fault", True)
    assert "cable out" in caplog.text
    bench.robot.broken = False
    bench.tick()
    assert _code(bench.command("c")) == "accepted"


@pytest.mark.parametrize(("at", "code"), [(3.1, "accepted"), (3.49, "accepted"), (3.6, "fault"), (-77.0, "fault")])
def test_a_joint_outside_its_limits_is_moved_back_unless_it_is_nonsense(at: float, code: str) -> None:
    """Other joints move in any case."""
    bench = Bench(limits=Limits(-3.0, 3.0, 1.0), arm=at)
    reply = bench.command("a", Move({"arm": 2.0}))
    assert _code(reply) == code
    assert not isinstance(reply, Refused) or "outside its limits: check its sensor" in reply.reason
    assert _code(bench.command("b", Move({"wheel": 2.0}))) == "accepted"


def test_the_condition_of_a_robot_is_told_when_it_changes_and_while_it_is_bad() -> None:
    """Once if it is good, each second if it is not, and to each gateway that arrives."""
    bench = Bench()
    bench.tick(300)
    assert [(each.fault, each.sensors) for each in bench.link.conditions] == [("", {})]
    bench.robot.broken = True
    bench.tick(250)
    assert [each.fault for each in bench.link.conditions[1:]] == ["read failed: cable out"] * 3
    bench.robot.broken = False
    bench.tick(300)
    assert [each.fault for each in bench.link.conditions[4:]] == [""]
    bench.robot.positions["arm"] = 3.0
    bench.tick(2)
    assert list(bench.link.conditions[-1].sensors) == ["arm"]
    assert "contradicts itself" in bench.link.conditions[-1].sensors["arm"]
    bench.tick(300)
    assert bench.link.conditions[-1].sensors == {}
    count = len(bench.link.conditions)
    bench.link.arrivals += 1
    bench.tick()
    assert len(bench.link.conditions) == count + 1


def test_a_driver_that_leaves_out_a_joint_has_a_fault() -> None:
    """It would be unknown to which joints the values belong."""
    bench = Bench()
    bench.robot.short = True
    bench.tick()
    assert math.isnan(bench.link.states[-1].positions[0])
    refused = bench.command("a")
    assert isinstance(refused, Refused)
    assert "of 2 joints" in refused.reason
    bench.robot.short = False
    bench.tick()
    assert _code(bench.command("b")) == "accepted"


@pytest.mark.parametrize("effort", [None, "0.1", math.inf])
def test_a_driver_that_measures_no_number_has_a_fault(effort: object, caplog: pytest.LogCaptureFixture) -> None:
    """No frame can state it. The agent goes on, also for the other robots of its process, and the robot holds."""
    bench = Bench()
    assert _code(bench.command("a")) == "accepted"
    bench.robot.effort = effort
    bench.tick(3)
    assert math.isnan(bench.link.states[-1].positions[0])
    assert (bench.end("a").state, bench.robot.stops) == ("failed", 1)
    assert _code(bench.command("b")) == "fault"
    assert len(caplog.records) == 1
    bench.robot.effort = 0.1
    bench.tick()
    assert _code(bench.command("c")) == "accepted"


@pytest.mark.parametrize("unstoppable", [False, True])
def test_a_robot_with_a_fault_is_stopped_by_its_driver(unstoppable: bool) -> None:
    """The stop is accepted and fails, because no standstill is measured. The reason says what the driver did."""
    bench = Bench()
    bench.robot.broken, bench.robot.unstoppable = True, unstoppable
    bench.tick()
    before = bench.robot.stops
    assert _code(bench.stop("s")) == "accepted"
    assert bench.robot.stops == before + 1
    bench.tick()
    assert bench.end("s").state == "failed"
    assert ("brake gone" if unstoppable else "told to hold") in bench.end("s").reason
    assert "cable out" in bench.end("s").reason
    assert not bench.end("s").positions


def test_a_stop_needs_no_gateway_no_time_and_no_run() -> None:
    """Reasons that refuse a command do not matter to a stop; only an unknown joint does."""
    bench = Bench()
    bench.command("a")
    bench.tick(20)
    bench.link.gateway_present = False
    assert _code(bench.stop("s", joints=["arm"])) == _code(bench.stop("s", joints=["arm"])) == "accepted"
    assert _code(bench.stop("t", joints=["leg"])) == "unknown-joint"
    bench.tick(100)
    assert bench.end("a").state == "cancelled"
    assert bench.end("s").state == "succeeded"
    assert _code(bench.command("b")) == "fault"


def test_no_motion_runs_after_a_stop_that_was_asked_for_before_it() -> None:
    """Motions of the stopped joints are refused; those after the next frame run, and rehearsals are judged alike."""
    bench = Bench()
    stopped = bench.stop("s", joints=["arm"])
    assert isinstance(stopped, Accepted)
    assert stopped.at_ns == bench.now_ns
    bench.tick()
    assert _code(bench.command("a", seen_ns=stopped.at_ns, rehearsal=True)) == "stale"
    refused = bench.command("a", Move({"wheel": 1.0, "arm": 1.0}), seen_ns=stopped.at_ns)
    assert isinstance(refused, Refused)
    assert (refused.code, "stopped after the command was requested" in refused.reason) == ("stale", True)
    bench.tick(10)
    assert bench.robot.positions == {"arm": 0.0, "wheel": 0.0}
    assert _code(bench.command("b", Move({"wheel": 1.0}), seen_ns=stopped.at_ns)) == "accepted"
    assert _code(bench.command("a", seen_ns=stopped.at_ns + 10_000_000)) == "accepted"


def test_a_stop_of_all_joints_counts_for_each_and_one_that_was_not_carried_out_for_none() -> None:
    bench = Bench()
    bench.stop("s", rehearsal=True)
    bench.stop("t", joints=["arm", "leg"])
    assert _code(bench.command("a")) == "accepted"
    bench.stop("u")
    assert {_code(bench.command("b", Move({name: 1.0}))) for name in ("arm", "wheel")} == {"stale"}
    bench.tick()
    assert _code(bench.command("b", Move({"wheel": 1.0}))) == "accepted"


def test_a_command_that_is_cancelled_before_it_comes_never_runs() -> None:
    """Other commands on its joints run, and a command accepted earlier is not affected."""
    bench = Bench()
    bench.stop("s", command="a", rehearsal=True)
    assert _code(bench.command("a", rehearsal=True)) == "accepted"
    bench.stop("s", command="a")
    bench.tick()
    refused = bench.command("a")
    assert isinstance(refused, Refused)
    assert (refused.code, "cancelled before it arrived" in refused.reason) == ("stale", True)
    assert _code(bench.command("b")) == "accepted"
    bench.stop("t", command="b")
    assert _code(bench.command("b")) == "repeated"


def test_commands_from_before_the_loss_of_all_gateways_are_refused() -> None:
    bench = Bench()
    bench.link.gateway_present = False
    bench.tick()
    lost_ns = bench.now_ns
    bench.link.gateway_present = True
    bench.tick()
    assert _code(bench.command("a", seen_ns=lost_ns)) == "stale"
    assert _code(bench.command("a")) == "accepted"


_LEASE_NS = GATEWAY_LEASE_MS * 1_000_000
_FIRST: Mapping[str, Callable[[Bench], object]] = {
    "a tick": lambda bench: bench.agent.tick(bench.link),
    "a command that waited": lambda bench: bench.command("waited", Move({"wheel": 1.0})),
    "a stop that waited": lambda bench: bench.stop("waited", joints=("wheel",)),
}


@pytest.mark.parametrize("first", _FIRST)
def test_an_agent_that_did_not_run_for_longer_than_the_lease_holds_first(first: str) -> None:
    """Its motions fail with the reason, and what was requested before never runs, whatever is handled first."""
    bench = Bench()
    assert _code(bench.command("before")) == "accepted"
    bench.tick(10)
    seen_ns, rest = bench.link.states[-1].monotonic_ns, dict(bench.robot.positions)
    bench.now_ns += _LEASE_NS + 600_000_000
    _FIRST[first](bench)
    assert _code(bench.command("late", Move({"wheel": 1.0}), seen_ns=seen_ns)) == "stale"
    bench.tick(200)
    end = bench.end("before")
    assert (end.state, end.reason) == ("failed", "the agent did not run for 3.1 s")
    assert bench.link.progress.count(end) == 2  # connections that are being renewed may lose the first
    assert not [progress for progress in bench.link.progress if progress.id == "late"]
    assert bench.robot.positions == rest
    assert _code(bench.command("after")) == "accepted"
    bench.tick(500)
    assert bench.robot.positions["arm"] == pytest.approx(1.0, abs=1e-3)


def test_a_command_that_waited_for_the_end_of_a_pause_is_stale() -> None:
    """It is handled before the first tick after the pause."""
    bench = Bench()
    bench.now_ns += _LEASE_NS + 1
    assert _code(bench.command("waited")) == "stale"


def test_a_demonstration_ends_with_a_pause() -> None:
    bench = Bench([Sway("arm", 0.5, 4.0)])
    bench.tick(50)
    bench.now_ns += _LEASE_NS + 600_000_000
    bench.tick(200)
    rest = dict(bench.robot.positions)
    bench.tick(400)
    assert bench.robot.positions == rest


def test_a_pause_as_long_as_the_lease_changes_nothing() -> None:
    bench = Bench()
    assert _code(bench.command("before")) == "accepted"
    bench.tick(10)
    bench.now_ns += _LEASE_NS - 10_000_000
    bench.tick(500)
    assert bench.end("before").state == "succeeded"


def test_a_suspended_machine_counts_as_a_pause() -> None:
    """The monotonic clock of Linux stands still meanwhile."""
    bench = Bench()
    assert _code(bench.command("before")) == "accepted"
    bench.tick(10)
    bench.suspended_ns = _LEASE_NS + 600_000_000
    bench.tick()
    assert bench.end("before").state == "failed"


def test_a_rehearsal_is_judged_and_answered_and_nothing_moves() -> None:
    """The answer contains duration and end; its id stays free, and a refusal equals that of the real command."""
    bench = Bench()
    bench.command("a", Move({"arm": 1.0, "wheel": 1.0}))
    bench.tick(10)
    rehearsed = bench.command("b", Move({"arm": 0.5}), rehearsal=True)
    assert isinstance(rehearsed, Accepted)
    assert rehearsed.preempts == ("a",)
    assert bench.stop("s", rehearsal=True).preempts == ("a",)  # type: ignore[union-attr]
    assert _code(bench.command("b", Move({"arm": 1e9}), rehearsal=True)) == "limits"
    bench.tick(400)
    assert bench.end("a").state == "succeeded"
    assert {progress.id for progress in bench.link.progress} == {"a"}
    assert _code(bench.command("b", Move({"arm": 0.5}))) == "accepted"
    bench.robot.broken = True
    bench.tick()
    assert _code(bench.command("c", rehearsal=True)) == "fault"


def test_a_command_with_an_unmet_expectation_is_refused() -> None:
    """The reason contains both positions; a continuous joint may be whole turns away."""
    bench = Bench()
    bench.robot.positions["wheel"] = 4 * math.pi + 0.01
    bench.tick()
    refused = bench.command("a", expects={"arm": Expectation(0.5, 0.1)})
    assert isinstance(refused, Refused)
    assert (refused.code, refused.reason) == (
        "expectation",
        "'arm' was expected at 0.5 rad, give or take 0.1 rad, but is at 0 rad",
    )
    bench.tick(10)
    assert bench.robot.positions["arm"] == 0.0
    both = {"arm": Expectation(0.0, 0.0), "wheel": Expectation(0.0, 0.02)}
    assert _code(bench.command("a", expects=both)) == "accepted"


def test_a_path_is_followed_or_refused_with_the_factor_that_would_do() -> None:
    bench = Bench()
    refused = bench.command("f", Follow(("arm",), (1.0,), ((1.0,),)))
    assert isinstance(refused, Refused)
    assert (refused.code, "by a factor of 3.000" in refused.reason) == ("limits", True)
    assert bench.command("f", Follow(("arm",), (3.0,), ((1.0,),))) == Accepted("f", 3.0, at_ns=bench.now_ns)
    bench.tick(310)
    assert bench.end("f").state == "succeeded"
    assert bench.robot.positions["arm"] == 1.0


_names = st.sampled_from(["arm", "wheel", "leg"])
_numbers = st.floats(allow_nan=False, allow_infinity=False) | st.floats(-3, 3)
_positive = st.floats(5e-324, 3600)


@st.composite
def _motions(draw: st.DrawFn) -> dict[str, object]:
    if draw(st.booleans()):
        return {
            "type": "move",
            "targets": draw(st.dictionaries(_names, _numbers, min_size=1)),
            "speeds": draw(st.dictionaries(_names, _positive)),
        }
    joints, rows = draw(st.lists(_names, min_size=1, max_size=2)), draw(st.integers(1, 4))
    return {
        "type": "follow",
        "joints": joints,
        "times_s": draw(st.lists(_positive, min_size=rows, max_size=rows).map(sorted)),
        "positions": draw(st.lists(st.lists(_numbers, min_size=len(joints), max_size=2), min_size=rows, max_size=rows)),
    }


@given(st.lists(st.tuples(_motions(), st.floats(5e-324, 1.0), st.booleans(), st.integers(1, 20)), max_size=5))
def test_random_commands_do_not_break_an_agent(
    orders: list[tuple[dict[str, object], float, bool, int]],
) -> None:
    """Each is accepted with a duration or refused with a reason, and the joints stay within their limits."""
    bench = Bench()
    for number, (motion, scale, rehearsal, ticks) in enumerate(orders):
        asked = {
            "version": 1,
            "id": f"c{number}",
            "incarnation": bench.agent.incarnation,
            "seen_ns": bench.now_ns,
            "time_to_live_ns": 60_000_000_000,
            "motion": motion,
            "scale": scale,
            "rehearsal": rehearsal,
        }
        reply = codec.decode_reply(bench.agent.handle(json.dumps(asked).encode()))
        if isinstance(reply, Accepted):
            assert 0.0 <= reply.duration_s <= 86_400.0
        else:
            assert reply.code in ("malformed", "unknown-joint", "limits")
            assert reply.reason
        bench.tick(ticks)
        assert all(abs(position) <= 1e6 for position in bench.robot.positions.values())


def test_a_gateway_that_comes_hears_how_motions_ended_and_what_runs() -> None:
    """Each new gateway gets one report of recent ends and running motions, even if other gateways are present."""
    bench = Bench()
    bench.command("old")
    bench.tick(300)
    bench.wait(50)
    bench.command("new", Move({"arm": 0.0}))
    bench.tick(300)
    bench.command("now", Move({"wheel": 100.0}))
    bench.tick()
    bench.link.progress.clear()
    bench.link.arrivals += 1
    bench.tick()
    assert [(p.id, p.state) for p in bench.link.progress] == [
        ("old", "succeeded"),
        ("new", "succeeded"),
        ("now", "running"),
    ]
    bench.tick()
    assert len(bench.link.progress) == 3
    bench.wait(10)
    bench.link.progress.clear()
    bench.link.arrivals += 1
    bench.tick()
    assert [p.id for p in bench.link.progress] == ["new", "now"]


async def test_a_stop_is_followed_by_a_frame_at_once() -> None:
    """Other gateways learn of the stop by a later frame. Many stops at once are followed by a single frame."""
    bench = Bench()
    running = asyncio.create_task(bench.agent.run(bench.link))
    await asyncio.sleep(0)
    before = len(bench.link.states)
    bench.now_ns += 5_000_000
    stopped = bench.stop("s")
    bench.stop("t")
    for _ in range(2):
        await asyncio.sleep(0)
    assert isinstance(stopped, Accepted)
    assert len(bench.link.states) == before + 1
    running.cancel()
    await asyncio.wait({running})


def test_a_robot_that_describes_itself_anew_holds_and_ends_its_run() -> None:
    bench = Bench()
    bench.command("a")
    bench.tick(20)
    before = bench.robot.stops
    bench.robot.anew = True
    with pytest.raises(NewDescriptionError):
        bench.tick()
    assert bench.robot.stops == before + 1
    assert bench.end("a").state == "failed" and "describes itself anew" in bench.end("a").reason
