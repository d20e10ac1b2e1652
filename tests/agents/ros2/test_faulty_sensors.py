"""An agent and its ROS 2 driver whose states are wrong, or whose arm is moved by another client.

Messages are made and read by rosbags alone; topics are in memory.
"""

import itertools
import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, cast

import pytest

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robot import Facts
from linked_fleet_agent.robots.ros2.address import parse_address
from linked_fleet_agent.robots.ros2.finding import facts_of
from linked_fleet_agent.robots.ros2.graph import Graph, Mailbox, ReceivedMessage
from linked_fleet_agent.robots.ros2.robot import Ros2Robot
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import Accepted, Command, Move, Progress, Refused, Reply, State, Stop
from ros2_robot import STORE, joint_state, text

pytestmark = pytest.mark.virtual

TICK_S = 0.01
SPEED = 1.0
"""The velocity limit of both joints."""
URDF = f"""<robot name="arm"><link name="base"/><link name="upper"/><link name="wheel"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <limit lower="-3.2" upper="3.2" velocity="{SPEED}" effort="5"/></joint>
  <joint name="turntable" type="continuous"><parent link="upper"/><child link="wheel"/>
    <limit velocity="{SPEED}" effort="5"/></joint></robot>"""

Positions = dict[str, float]
Sensor = Callable[[Positions, int], list[Positions]]
"""Returns the messages of one cycle, given the true positions and the number of the cycle."""


def honest(positions: Positions, cycle: int) -> list[Positions]:
    return [positions]


class Arm:
    """Two joints and their controller, which passes through the points that it is sent. It stands in for a session."""

    def __init__(self, positions: Positions) -> None:
        self.positions = positions
        self.sent: list[Positions] = []
        self.sensor: Sensor = honest
        self.velocities: list[float] = [0.0, 0.0]
        self.other_client: Positions = {}
        """Velocities at which another client of the controller moves joints, until a point arrives."""
        self.stubborn = False
        """The other client sends its next point at once."""
        self.has_subscribers = True
        self._cycle = 0
        self._inbox: list[ReceivedMessage] = []
        self._goal, self._left_s = dict(positions), 0.0

    def subscribe(self, *_: object) -> "Arm":
        return self

    outlet = subscribe

    def close(self) -> None:
        """Nothing is open."""

    def fetch(self) -> list[ReceivedMessage]:
        waiting, self._inbox = self._inbox, []
        return waiting

    def put(self, payload: bytes) -> None:
        message: Any = STORE.deserialize_cdr(payload, "trajectory_msgs/msg/JointTrajectory")
        (point,) = message.points
        self._goal = dict(zip(message.joint_names, map(float, point.positions), strict=True))
        assert self._goal.keys() == self.positions.keys()
        self._left_s = point.time_from_start.sec + point.time_from_start.nanosec / 1e9
        self.sent.append(self._goal)
        if not self.stubborn:
            self.other_client = {}

    def live(self) -> None:
        """Advance by one cycle and say the states."""
        self._cycle += 1
        share = min(1.0, TICK_S / self._left_s) if self._left_s > 0.0 else 1.0
        for name, goal in self._goal.items():
            if name in self.other_client:
                self.positions[name] += self.other_client[name] * TICK_S
                self._goal[name] = self.positions[name]
            else:
                self.positions[name] += share * (goal - self.positions[name])
        self._left_s -= TICK_S
        for said in self.sensor(dict(self.positions), self._cycle):
            payload = joint_state(list(said), list(said.values()), self.velocities, stamp_ns=time.time_ns())
            self._inbox.append(ReceivedMessage(payload, time.monotonic()))


class Bench:
    """An agent with this arm and a gateway that only listens."""

    gateway_present = True
    arrivals = 1

    def __init__(self, **positions: float) -> None:
        self.arm = Arm({"shoulder": 0.0, "turntable": 0.0} | positions)
        self.frames: list[State] = []
        self.progress: list[Progress] = []
        address, session = parse_address("ros2:tcp/127.0.0.1:1?stale=0.5"), cast(Graph, self.arm)
        driver = Ros2Robot("arm", address, _facts(), session, Mailbox(1, 1))
        self.agent = Agent("arm", driver)
        self.path = [dict(self.arm.positions)]
        self.run(0.5)

    def watch_gateways(self, period_s: float) -> None:
        """Do nothing: a gateway is present."""

    def publish_state(self, payload: bytes) -> None:
        self.frames.append(codec.decode_state(payload))

    def publish_condition(self, payload: bytes) -> None:
        """Ignore it."""

    publish_values = publish_event = publish_condition

    def publish_progress(self, payload: bytes, final: bool) -> None:
        self.progress.append(codec.decode(payload, Progress))

    def run(self, seconds: float, sensor: Sensor = honest) -> None:
        self.arm.sensor = sensor
        for _ in range(round(seconds / TICK_S)):
            time.sleep(TICK_S)
            self.arm.live()
            self.path.append(dict(self.arm.positions))
            self.agent.tick(self)

    def move(self, command_id: str, **targets: float) -> Reply:
        command = Command(
            version=1,
            id=command_id,
            incarnation=self.agent.incarnation,
            seen_ns=self.frames[-1].monotonic_ns,
            time_to_live_ns=60_000_000_000,
            motion=Move(targets),
        )
        return codec.decode_reply(self.agent.handle(codec.encode(command)))

    def stop(self, stop_id: str, *joints: str) -> Reply:
        return codec.decode_reply(self.agent.handle_stop(codec.encode(Stop(version=1, id=stop_id, joints=joints))))

    def end(self, command_id: str) -> Progress:
        return [each for each in self.progress if each.id == command_id][-1]

    def measured(self) -> Mapping[str, float]:
        return dict(zip(("shoulder", "turntable"), self.frames[-1].positions, strict=True))

    def check_setpoints(self) -> None:
        """Check that no setpoint, and no place of the arm, is further from the one before than its speed allows."""
        for before, after in itertools.pairwise(self.arm.sent):
            for name in before:
                assert abs(after[name] - before[name]) <= SPEED * TICK_S * 1.01 + 1e-6, (name, before, after)
        for before, after in itertools.pairwise(self.path):
            for name in before:
                assert abs(after[name] - before[name]) <= 1.6 * SPEED * TICK_S, (name, before, after)


def _facts() -> Facts:
    return facts_of("arm", ReceivedMessage(text(URDF), 0.0))


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench(shoulder=0.8, turntable=2.8)
    yield made
    made.check_setpoints()


def outlier(positions: Positions, cycle: int) -> list[Positions]:
    return [positions | {"shoulder": positions["shoulder"] - 1.05}]


def zeros_beside(positions: Positions, cycle: int) -> list[Positions]:
    return [positions, dict.fromkeys(positions, 0.0)]


def zeros_before(positions: Positions, cycle: int) -> list[Positions]:
    return [dict.fromkeys(positions, 0.0), positions]


def zeros_at_times(positions: Positions, cycle: int) -> list[Positions]:
    return [positions if cycle % 3 else dict.fromkeys(positions, 0.0)]


def wrapped(positions: Positions, cycle: int) -> list[Positions]:
    return [positions | {"turntable": math.remainder(positions["turntable"], math.tau)}]


def seam(positions: Positions, cycle: int) -> list[Positions]:
    return [positions | {"shoulder": positions["shoulder"] - (math.tau if positions["shoulder"] > 1.0 else 0.0)}]


@pytest.mark.parametrize(
    ("sensor", "lasts_s"), [(outlier, 0.01), (outlier, 0.02), (outlier, 0.12), (zeros_at_times, 0.3), (seam, 2.0)]
)
def test_a_wrong_sample_in_a_motion_is_a_fault_and_the_joint_holds_its_last_setpoint(
    bench: Bench, sensor: Sensor, lasts_s: float
) -> None:
    assert isinstance(bench.move("m", shoulder=1.6), Accepted)
    bench.run(0.5)
    before = bench.arm.positions["shoulder"]
    bench.run(lasts_s, sensor)
    bench.run(0.5)
    assert bench.end("m").state == "failed"
    assert "the sensor of shoulder contradicts itself" in bench.end("m").reason
    assert 0.0 <= bench.arm.positions["shoulder"] - before < 0.4
    stood = bench.arm.positions["shoulder"]
    refused = bench.move("n", shoulder=1.6)
    assert isinstance(refused, Refused) and "contradicts itself" in refused.reason
    assert math.isnan(bench.measured()["shoulder"])
    bench.run(1.5)
    assert bench.arm.positions["shoulder"] == pytest.approx(stood)
    assert isinstance(bench.move("o", shoulder=1.6), Accepted)
    bench.run(3.0)
    assert bench.end("o").state == "succeeded"


@pytest.mark.parametrize("sensor", [outlier, zeros_beside, zeros_before, zeros_at_times])
def test_a_joint_at_rest_is_not_commanded_where_wrong_samples_show_it(bench: Bench, sensor: Sensor) -> None:
    bench.run(0.12, sensor)
    for number in range(10):
        assert isinstance(bench.move(f"m{number}", shoulder=-0.25), Refused)
        bench.run(0.02, sensor)
    bench.run(3.0)
    assert bench.arm.positions["shoulder"] == 0.8
    assert bench.arm.sent == []


@pytest.mark.parametrize("turns", [0, 2, -3])
def test_a_turntable_that_shows_angles_within_a_turn_never_jumps_by_one(turns: int) -> None:
    bench = Bench(shoulder=0.8, turntable=2.8 + turns * math.tau)
    bench.run(2.0, wrapped)
    for number, (target, end) in enumerate([(3.6, 3.6), (3.6 - math.tau + 1.0, 4.6), (4.6 - math.tau - 3.0, 1.6)]):
        assert isinstance(bench.move(f"m{number}", turntable=target), Accepted)
        bench.run(5.0, wrapped)
        assert bench.end(f"m{number}").state == "succeeded"
        assert math.remainder(bench.arm.positions["turntable"] - end, math.tau) == pytest.approx(0.0, abs=1e-3)
    bench.check_setpoints()


@pytest.mark.parametrize("velocities", [[0.0, 0.0], []])
@pytest.mark.parametrize("joints", [(), ("shoulder",)])
@pytest.mark.parametrize("speed", [0.1, 0.9])
def test_a_stop_holds_an_arm_that_another_client_moves(
    bench: Bench, velocities: list[float], joints: tuple[str, ...], speed: float
) -> None:
    bench.arm.velocities, bench.arm.other_client = velocities, {"shoulder": speed}
    bench.run(0.5)
    assert isinstance(bench.stop("s", *joints), Accepted)
    stopped = bench.arm.positions["shoulder"]
    bench.run(0.1)
    assert bench.end("s").state == "running"
    bench.run(1.0)
    assert bench.end("s").state == "succeeded"
    assert bench.arm.positions["shoulder"] == pytest.approx(stopped, abs=0.05)
    count = len(bench.arm.sent)
    bench.run(1.0)
    assert len(bench.arm.sent) == count  # another client may take the arm over after the stop


@pytest.mark.parametrize("velocities", [[0.0, 0.0], []])
def test_a_stop_that_another_client_overrides_fails(bench: Bench, velocities: list[float]) -> None:
    bench.arm.velocities, bench.arm.other_client, bench.arm.stubborn = velocities, {"shoulder": 0.3}, True
    bench.run(0.5)
    bench.stop("s")
    bench.run(1.5)
    assert bench.end("s").state == "running"
    bench.run(1.5)
    assert (bench.end("s").state, bench.end("s").reason) == ("failed", "not come to rest: shoulder")
    assert len(bench.arm.sent) > 100
    bench.arm.sent.clear()  # the arm was dragged away from the setpoints, which the agent kept


def test_a_motion_begins_where_another_client_has_moved_the_arm(bench: Bench) -> None:
    """While it moves, motions are accepted from where it is, and no setpoint lies behind."""
    bench.arm.other_client = {"shoulder": 0.5}
    bench.run(1.0)
    assert isinstance(bench.move("m", shoulder=1.0), Accepted)
    bench.run(0.02)
    assert bench.arm.sent[0]["shoulder"] == pytest.approx(1.3, abs=0.02)
    bench.run(3.0)
    assert bench.end("m").state == "succeeded"


def test_messages_that_were_held_up_are_no_fault(bench: Bench) -> None:
    """The network delays states by 0.2 s while the arm moves, and delivers them at once."""
    held: list[Positions] = []

    def bursts(positions: Positions, cycle: int) -> list[Positions]:
        held.append(positions)
        if cycle % 20:
            return []
        said, held[:] = list(held), []
        return said

    assert isinstance(bench.move("m", shoulder=2.4), Accepted)
    bench.run(4.0, bursts)
    assert bench.end("m").state == "succeeded"
