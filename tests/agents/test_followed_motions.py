"""Motions that the controllers of a robot follow themselves, on the test's own clock."""

import math
from collections.abc import Collection, Mapping, Sequence

import pytest

from component_agent import Memory
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robot import Facts, FollowedEnd, JointFacts, Reading
from linked_fleet_agent.trajectory import Trajectory
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import Command, Move, Progress, Refused, Reply, Stop

_URDF = """<robot name="r"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
  <joint name="pan" type="continuous"><parent link="base"/><child link="a"/></joint>
  <joint name="lift" type="continuous"><parent link="base"/><child link="b"/></joint>
  <joint name="head" type="continuous"><parent link="base"/><child link="c"/></joint></robot>"""
_JOINTS = ("pan", "lift", "head")


class FollowingRobot:
    """One controller has pan and lift, another one the head. Joints reach setpoints at once."""

    declines = False

    def __init__(self) -> None:
        self.positions = dict.fromkeys(_JOINTS, 0.0)
        self.held: dict[str, str] = {}
        self.followed: dict[str, Mapping[str, Trajectory]] = {}
        self.begun_s: dict[str, float] = {}
        self.ends: list[FollowedEnd] = []
        self.sent: list[Mapping[str, float]] = []
        self.left: list[str] = []
        self.others: list[tuple[str, ...]] = []
        self.now_s = 0.0

    def describe(self) -> Facts:
        joints = tuple(JointFacts(name, continuous=True) for name in _JOINTS)
        return Facts("r", _URDF, joints, coupled=(("pan", "lift"), ("head",)))

    def read(self, now_s: float) -> Reading:
        self.now_s = now_s
        for id, trajectories in self.followed.items():
            for name, each in trajectories.items():
                self.positions[name], _ = each.at(now_s - self.begun_s.setdefault(id, now_s))
        return Reading(tuple(self.positions.values()), (math.nan,) * 3, (math.nan,) * 3, held=self.held)

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        self.sent.append(dict(setpoints))
        self.positions |= setpoints
        return setpoints

    def stop(self) -> None: ...

    def close(self) -> None: ...

    def follow(self, id: str, trajectories: Mapping[str, Trajectory]) -> bool:
        if not self.declines:
            self.followed[id] = trajectories
        return not self.declines

    def leave(self, id: str) -> None:
        self.left.append(id)
        self.followed.pop(id, None)

    def ended(self) -> Sequence[FollowedEnd]:
        ends, self.ends = self.ends, []
        return ends

    def end_others(self, joints: Collection[str]) -> None:
        self.others.append(tuple(joints))

    @property
    def ended_others(self) -> str:
        return "a goal of another client was cancelled" if self.others else ""

    def finish(self, id: str, reason: str = "") -> None:
        self.followed.pop(id)
        self.ends.append(FollowedEnd(id, reason))


class Bench:
    """An agent with a following robot, a link without a network and a clock."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000
        self.robot, self.link = FollowingRobot(), Memory()
        self.agent = Agent("r", self.robot, monotonic_ns=lambda: self.now_ns)
        self.tick()

    def tick(self, seconds: float = 0.01) -> None:
        for _ in range(round(seconds / 0.01)):
            self.now_ns += 10_000_000
            self.agent.tick(self.link)

    def move(self, id: str, **targets: float) -> Reply:
        asked = Command(
            version=1, id=id, incarnation=self.agent.incarnation, seen_ns=self.link.states[-1].monotonic_ns,
            time_to_live_ns=60_000_000_000, motion=Move(targets),
        )  # fmt: skip
        return codec.decode_reply(self.agent.handle(codec.encode(asked)))

    def stop(self, id: str) -> None:
        self.agent.handle_stop(codec.encode(Stop(version=1, id=id)))

    def end(self, id: str) -> Progress:
        return [progress for progress in self.link.progress if progress.id == id][-1]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_controller_follows_a_motion_and_no_setpoints_are_sent(bench: Bench) -> None:
    bench.move("m", pan=0.5)
    assert set(bench.robot.followed["m"]) == {"pan", "lift"}, "all joints of the controller, and no other"
    assert bench.robot.followed["m"]["pan"].end == 0.5 and bench.robot.followed["m"]["lift"].end == 0.0
    bench.tick(3.0)
    assert bench.end("m").state == "running", "only the controller says that it has ended"
    bench.robot.finish("m")
    bench.tick(0.1)
    assert (bench.end("m").state, bench.robot.sent, bench.robot.left) == ("succeeded", [], [])


def test_a_controller_that_ends_elsewhere_has_not_succeeded(bench: Bench) -> None:
    bench.move("m", pan=0.5)
    bench.tick(0.5)
    bench.robot.finish("m")
    bench.tick(4.0)
    assert bench.end("m").state == "failed"
    assert "its target is 0.5 rad" in bench.end("m").reason


def test_the_reason_of_a_controller_is_that_of_the_failure_and_the_joint_is_held(bench: Bench) -> None:
    bench.move("m", pan=2.0)
    bench.tick(0.5)
    at = bench.robot.positions["pan"]
    bench.robot.finish("m", "the controller gave up: path tolerance violated")
    bench.tick(1.0)
    assert (bench.end("m").state, bench.end("m").reason) == (
        "failed",
        "the controller gave up: path tolerance violated",
    )
    assert bench.robot.positions["pan"] == pytest.approx(at, abs=0.02)
    bench.move("n", pan=0.0)
    assert bench.robot.followed["n"]["pan"].at(0.0)[0] == pytest.approx(at, abs=0.02)


def test_a_stop_leaves_the_motion_brakes_and_ends_what_others_move(bench: Bench) -> None:
    bench.move("m", pan=2.0)
    bench.tick(0.5)
    bench.stop("s")
    assert (bench.robot.left, bench.robot.others) == (["m"], [(*_JOINTS, "base")])
    bench.tick(1.0)
    assert bench.end("m").state == "cancelled"
    assert (bench.end("s").state, bench.end("s").reason) == ("succeeded", "a goal of another client was cancelled")
    assert 0.0 < bench.robot.positions["pan"] < 1.0
    assert bench.robot.sent, "the joints brake by setpoints"


def test_a_newer_motion_replaces_what_the_controller_follows(bench: Bench) -> None:
    bench.move("m", pan=2.0)
    bench.tick(0.5)
    bench.move("n", pan=-1.0, lift=0.2)
    assert bench.robot.left == ["m"]
    begin, velocity = bench.robot.followed["n"]["pan"].at(0.0)
    assert begin == pytest.approx(bench.robot.positions["pan"], abs=0.02) and velocity > 0.0
    bench.tick()
    assert bench.end("m").state == "preempted"


def test_two_motions_on_one_controller_get_setpoints(bench: Bench) -> None:
    """A controller follows one trajectory at a time, and clients may move its joints apart."""
    bench.move("m", pan=1.0)
    bench.tick(0.3)
    bench.move("n", lift=1.0)
    bench.tick(0.02)
    assert bench.robot.left == ["m"]
    assert set(bench.robot.sent[-1]) == {"pan", "lift"}
    steps = [sent["pan"] for sent in bench.robot.sent]
    bench.tick(5.0)
    assert [bench.end(id).state for id in "mn"] == ["succeeded", "succeeded"]
    assert steps[0] == pytest.approx(0.3, abs=0.25), "it goes on from where it was"


def test_motions_of_two_controllers_are_followed_side_by_side(bench: Bench) -> None:
    bench.move("m", pan=1.0)
    bench.move("n", head=1.0)
    assert set(bench.robot.followed) == {"m", "n"}


def test_a_robot_that_declines_gets_setpoints(bench: Bench) -> None:
    bench.robot.declines = True
    bench.move("m", pan=0.3)
    bench.tick(3.0)
    assert (bench.end("m").state, bench.robot.left) == ("succeeded", [])
    assert bench.robot.positions["pan"] == pytest.approx(0.3)


def test_the_loss_of_the_last_gateway_ends_what_controllers_follow(bench: Bench) -> None:
    bench.move("m", pan=2.0)
    bench.tick(0.3)
    bench.link.gateway_present = False
    bench.tick(0.02)
    assert (bench.end("m").state, bench.robot.left) == ("failed", ["m"])


def test_a_joint_that_takes_no_commands_now_refuses_with_the_reason(bench: Bench) -> None:
    bench.robot.held = {"pan": "arm_controller is inactive"}
    bench.tick(0.02)
    reply = bench.move("m", pan=1.0)
    assert isinstance(reply, Refused)
    assert reply.reason == "pan takes no command now: arm_controller is inactive"
    assert bench.link.conditions[-1].sensors == {"pan": "arm_controller is inactive"}
    assert not isinstance(bench.move("n", head=1.0), Refused)
