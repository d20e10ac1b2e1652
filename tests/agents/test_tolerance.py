"""How near to their targets joints come: tolerances and resolutions that drivers declare, and what is said of them."""

import asyncio
import json
import math
from collections.abc import Mapping
from dataclasses import replace

import pytest

from component_agent import Bench, ExactRobot
from linked_fleet_agent.robot import Facts, JointFacts, Reading

STEP = math.tau / 4096


class Servo(ExactRobot):
    """A robot whose servos have an encoder of 4096 steps a turn, and stay where they are for less than a step."""

    def __init__(self, **declared: float) -> None:
        super().__init__()
        self._declared = declared

    def describe(self) -> Facts:
        said = super().describe()
        return replace(said, joints=tuple(replace(joint, **self._declared) for joint in said.joints))

    def read(self, now_s: float) -> Reading:
        return Reading(tuple(self.positions.values()), (0.0, 0.0), (0.0, 0.0))

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        off = {name: at for name, at in setpoints.items() if abs(at - self.positions[name]) >= STEP}
        self.positions |= {name: STEP * math.trunc(at / STEP) for name, at in off.items()}
        return setpoints


@pytest.mark.parametrize("target", [1.0, 0.001, -0.0005])
@pytest.mark.parametrize("declared", [{"resolution": STEP}, {"tolerance": 0.002}])
def test_a_servo_arrives_as_near_as_its_driver_says(target: float, declared: dict[str, float]) -> None:
    assert _end_of_motion(Servo(**declared), target) == "succeeded"


def test_a_servo_whose_driver_says_nothing_arrives_no_less_exactly_than_its_sensor_shows() -> None:
    """A step is known once one was seen; before, a target between two steps is not reached."""
    assert _end_of_motion(Servo(), 1.0) == "succeeded"
    assert _end_of_motion(Servo(), 0.001) == "failed"
    assert _end_of_motion(Servo(resolution=1e-6), 0.001) == "failed"


def _end_of_motion(robot: Servo, target: float) -> str:
    async def moved() -> str:
        bench = Bench(other=robot)
        await bench.tick(0.1)
        bench.move("m", arm=target)
        await bench.tick(6.0)
        return bench.end("m").state

    return asyncio.run(moved())


@pytest.mark.parametrize(
    ("joint", "tolerance"),
    [
        (JointFacts("j"), None),
        (JointFacts("j", resolution=STEP), STEP),
        (JointFacts("j", resolution=1e-6), 2e-4),
        (JointFacts("j", resolution=STEP, tolerance=0.01), 0.01),
        (JointFacts("j", resolution=0.01, tolerance=1e-3), 1e-3),
    ],
)
def test_a_tolerance_is_declared_or_one_step_of_the_sensor(joint: JointFacts, tolerance: float | None) -> None:
    assert joint.arrival_tolerance == tolerance


def test_the_description_has_the_tolerances_of_joints_that_take_commands() -> None:
    class Mixed(ExactRobot):
        def describe(self) -> Facts:
            arm, finger = super().describe().joints
            joints = (replace(arm, resolution=STEP), replace(finger, tolerance=0.01, passive=True))
            return replace(super().describe(), joints=joints)

    assert json.loads(Bench(other=Mixed()).agent.description)["tolerances"] == {"arm": STEP}
    assert json.loads(Bench(other=ExactRobot()).agent.description)["tolerances"] == {}
