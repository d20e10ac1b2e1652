"""Sensor faults of each driver: whatever is measured, no setpoint jumps."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robot import Facts, JointFacts, Reading, Robot
from linked_fleet_agent.robots.mujoco_robot import MujocoRobot
from linked_fleet_agent.sensors import TRUST_S
from linked_fleet_agent.setpoints import HOLDING, rate_of
from linked_fleet_agent.urdf import joints_of
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import Command, Move, Stop
from properties import examples
from sensor_faults import EVENTS, Event, shown_position

URDF = """<robot name="two"><link name="a"/>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="c"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="arm" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" velocity="1" effort="50"/></joint>
<joint name="wheel" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
  <limit velocity="2" effort="50"/></joint></robot>"""
FACTS = Facts("two", URDF, joints_of(URDF))
TICK_S = 0.01


class Ideal:
    """A robot that is where it was sent."""

    def __init__(self) -> None:
        self.positions = [0.0, 0.0]

    def describe(self) -> Facts:
        return FACTS

    def read(self, now_s: float) -> Reading:
        return Reading((self.positions[0], self.positions[1]), (0.0, 0.0), (math.nan,) * 2)

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        for index, joint in enumerate(FACTS.joints):
            self.positions[index] = setpoints.get(joint.name, self.positions[index])
        return setpoints

    def stop(self) -> None:
        """Do nothing: it stands."""

    def close(self) -> None:
        """Nothing is open."""


class Faulty:
    """A robot whose sensors have faults. It notes the setpoints that it is sent."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.event, self.cycle, self.joint = Event(1, "none", 0.0, "nothing"), 0, 0
        self.shown = [0.0, 0.0]
        self.sent: dict[str, list[tuple[int, float]]] = {"arm": [], "wheel": []}
        """By joint the setpoints, each with the number of its cycle."""
        self.history: list[tuple[float, ...]] = []
        """The positions that the sensors have shown, by cycle."""

    def describe(self) -> Facts:
        return self._robot.describe()

    def begin(self, event: Event, joint: int) -> None:
        self.event, self.cycle, self.joint, self._frozen = event, 0, joint, self.shown[joint]

    def read(self, now_s: float) -> Reading:
        reading = self._robot.read(now_s)
        self.shown = list(reading.positions)
        if self.event.kind != "none":
            true = reading.positions[self.joint]
            self.shown[self.joint] = shown_position(self.event, self.cycle, true, self._frozen)
        self.cycle += 1
        self.history.append(tuple(self.shown))
        return reading._replace(positions=tuple(self.shown))

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        for name, setpoint in setpoints.items():
            self.sent[name].append((len(self.history), setpoint))
        return self._robot.apply(setpoints)

    def stop(self) -> None:
        self._robot.stop()

    def close(self) -> None:
        self._robot.close()


class Gateway:
    gateway_present = True
    arrivals = 1
    seen_ns = 0

    def watch_gateways(self, period_s: float) -> None:
        """Do nothing: it is present."""

    def publish_state(self, payload: bytes) -> None:
        self.seen_ns = codec.decode_state(payload).monotonic_ns

    def publish_condition(self, payload: bytes) -> None:
        """Ignore it."""

    publish_values = publish_event = publish_condition

    def publish_progress(self, payload: bytes, final: bool) -> None:
        """Ignore it."""


def furthest(joint: JointFacts, shown: Sequence[float]) -> float:
    """Return how far from 0 the first setpoint of a joint can be after its sensor has shown these positions.

    A position that differs from the one before by more than three times the velocity limit and noise allow is believed
    again after ``TRUST_S``. While one is believed, the setpoint follows it at the velocity limit.
    """
    follows_s, before, measured, doubted = 0.0, shown[0], 0, -math.inf
    for cycle, position in enumerate(shown):
        if math.isnan(position):
            continue
        possible = 0.02 + 3.0 * rate_of(joint) * max(2, cycle - measured) * TICK_S
        if abs(joint.difference(position, before)) > possible:
            doubted = cycle
        before, measured = position, cycle
        if abs(joint.difference(position, 0.0)) > HOLDING and (cycle - doubted) * TICK_S >= TRUST_S - 1e-9:
            follows_s += TICK_S
    return HOLDING + rate_of(joint) * (follows_s + TICK_S) + 1e-8


BELIEVED_AGAIN = [Event(60, "shift", 3.0, "nothing"), Event(51, "freeze", 0.0, "move")]
NEVER_DOUBTED = [Event(30, "shift", 1.3, "nothing"), Event(30, "shift", 2.6, "nothing")]
OUTLIER_FROZEN = [Event(5, "outlier", 3.0, "nothing"), *[Event(60, "freeze", 0.0, "nothing")] * 2]


@pytest.mark.parametrize("made", [Ideal, lambda: MujocoRobot("two", FACTS)], ids=["ideal", "mujoco"])
@settings(max_examples=examples(100))
@given(events=EVENTS, joint=st.integers(0, 1))
@example(events=BELIEVED_AGAIN, joint=1)
@example(events=NEVER_DOUBTED, joint=1)
@example(events=OUTLIER_FROZEN, joint=0)
def test_no_sensor_fault_makes_a_setpoint_jump(made: Callable[[], Robot], events: list[Event], joint: int) -> None:
    robot, gateway, now_ns = Faulty(made()), Gateway(), 10**9
    agent = Agent("two", robot, rate_hz=1.0 / TICK_S, monotonic_ns=lambda: now_ns)
    name = FACTS.joints[joint].name
    for number, event in enumerate([Event(30, "none", 0.0, "nothing"), *events, Event(30, "none", 0.0, "stop")]):
        if event.order == "move":
            command = Command(
                version=1, id=f"m{number}", incarnation=agent.incarnation, seen_ns=gateway.seen_ns,
                time_to_live_ns=10**9, motion=Move({name: event.size}),
            )  # fmt: skip
            agent.handle(codec.encode(command))
        elif event.order == "stop":
            agent.handle_stop(codec.encode(Stop(version=1, id=f"s{number}")))
        robot.begin(event, joint)
        for _ in range(event.cycles):
            now_ns += round(TICK_S * 1e9)
            agent.tick(gateway)
    for index, each in enumerate(FACTS.joints):
        for (cycle, before), (later, after) in itertools.pairwise(robot.sent[each.name]):
            assert abs(after - before) <= rate_of(each) * (later - cycle) * TICK_S + 1e-8
        for cycle, first in robot.sent[each.name][:1]:
            assert abs(first) <= furthest(each, [shown[index] for shown in robot.history[:cycle]])
