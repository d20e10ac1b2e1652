"""Which measured positions are believed, and when a joint stands."""

import math

import pytest

from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.sensors import TRUST_S, JointSensor

ARM = JointFacts("arm", limits=Limits(-3.0, 3.0, 1.0))
WHEEL = JointFacts("wheel", continuous=True, limits=Limits(velocity=1.0))
LIFT = JointFacts("lift", linear=True, limits=Limits(velocity=0.1))
HZ = 100


def doubted(joint: JointFacts, samples: list[tuple[float, float]]) -> bool:
    """Return True if the sensor is doubted after samples of a time and a position, which begin with a second at 0."""
    sensor = JointSensor(joint, 1.0 / HZ)
    for number in range(HZ):
        sensor.update(0.0, number / HZ)
    for at_s, position in samples:
        sensor.update(position, 1.0 + at_s)
    return bool(sensor.fault)


def line(speed: float, seconds: float, hz: float = HZ) -> list[tuple[float, float]]:
    return [(number / hz, speed * number / hz) for number in range(1, round(seconds * hz))]


def burst(speed: float, delay_s: float) -> list[tuple[float, float]]:
    """Return samples of which all of each ``delay_s`` arrive together."""
    return [(math.ceil(at_s / delay_s) * delay_s, position) for at_s, position in line(speed, 2.0)]


@pytest.mark.parametrize(
    ("joint", "samples"),
    [
        (ARM, line(1.0, 3.0)),  # at its limit
        (ARM, line(2.8, 3.0)),  # its limit is a guess, or gravity or a hand moves it
        (ARM, line(1.0, 3.0, hz=10)),
        (ARM, burst(1.0, 0.1)),
        (ARM, burst(1.0, 0.2)),
        (ARM, [(0.5, 0.5), (0.51, 0.5)]),  # nothing came for half a second
        (ARM, [(0.01 * n, 0.004 * (-1) ** n) for n in range(300)]),  # noise
        (WHEEL, [(at_s, math.remainder(position, math.tau)) for at_s, position in line(1.0, 20.0)]),
        (LIFT, line(0.1, 3.0)),
        (JointFacts("unknown"), line(3.0, 3.0)),
    ],
)
def test_what_a_joint_can_do_is_believed(joint: JointFacts, samples: list[tuple[float, float]]) -> None:
    assert not doubted(joint, samples)


@pytest.mark.parametrize("delay_s", [0.08, 0.2])
def test_states_that_come_seldom_and_in_bursts_are_believed(delay_s: float) -> None:
    sensor = JointSensor(JointFacts("fast", limits=Limits(velocity=3.0)), 0.04)
    for at_s, position in line(3.0, 4.0, hz=25):
        sensor.update(position, math.ceil(at_s / delay_s - 1e-9) * delay_s)
        assert not sensor.fault


@pytest.mark.parametrize(
    ("joint", "samples"),
    [
        (ARM, [(0.01, 1.05)]),
        (ARM, [(0.01, 0.1)]),
        (ARM, [(0.01, -math.tau)]),
        (ARM, [(0.5, 2.0)]),
        (ARM, [(0.01 * n, 0.04 * (n % 2)) for n in range(120)]),  # two publishers that are not far apart
        (ARM, line(5.0, 1.0)),
        (WHEEL, [(0.01, 2.0)]),
        (WHEEL, [(0.01, math.pi)]),
        (LIFT, [(0.01, 0.02)]),
        (JointFacts("unknown"), [(0.01, 0.3)]),
        (JointFacts("huge", limits=Limits(velocity=1.797e308)), [(0.01, 3.0)]),
    ],
)
def test_what_no_joint_can_do_is_a_fault_of_the_sensor(joint: JointFacts, samples: list[tuple[float, float]]) -> None:
    assert doubted(joint, samples)


def test_a_sensor_is_believed_again_when_it_was_consistent() -> None:
    sensor = JointSensor(ARM, 0.01)
    sensor.update(0.0, 0.0)
    assert math.isnan(sensor.update(1.0, 0.01))
    assert "arm contradicts itself: the position changed by 1 rad within 10 ms" in sensor.fault
    assert math.isnan(sensor.update(1.0, TRUST_S))
    assert sensor.update(1.0, 0.01 + TRUST_S) == 1.0
    assert not sensor.fault
    sensor.update(0.0, 1.1)
    sensor.forget()
    assert sensor.update(2.0, 1.2) == 2.0


def test_an_unknown_position_is_no_news() -> None:
    sensor = JointSensor(ARM, 0.01)
    assert math.isnan(sensor.update(math.nan, 0.0))
    assert sensor.standing_s == 0.0
    sensor.update(0.5, 0.1)
    assert math.isnan(sensor.update(math.nan, 0.2))
    assert sensor.update(0.51, 0.3) == 0.51


@pytest.mark.parametrize(
    ("positions", "standing_s"),
    [
        ([0.0] * 30, 0.29),
        ([0.001 * (-1) ** n for n in range(30)], 0.29),  # noise
        ([0.1 * n / HZ for n in range(30)], 0.01),  # it creeps
        ([*(0.5 * n / HZ for n in range(20)), *[0.095] * 10], 0.10),
    ],
)
def test_a_joint_stands_while_its_position_stays_in_one_place(positions: list[float], standing_s: float) -> None:
    sensor = JointSensor(ARM, 1.0 / HZ)
    for number, position in enumerate(positions):
        sensor.update(position, number / HZ)
    assert sensor.standing_s == pytest.approx(standing_s, abs=0.011)


def test_a_sample_that_is_shown_again_does_not_let_a_joint_stand_longer() -> None:
    """The robot is silent: nobody knows if it stands."""
    sensor = JointSensor(ARM, 0.01)
    for _ in range(100):
        sensor.update(0.5, 3.0)
    assert sensor.standing_s == 0.0
