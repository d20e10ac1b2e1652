"""The contract of drivers (linked_fleet_agent/robot.py); run it with your own driver (deploy/README.md)."""

import math
from collections.abc import Callable

import pytest

from linked_fleet_agent.robot import JointFacts, Reading, Robot
from linked_fleet_agent.urdf import joints_of

_PERIOD_S = 0.01
_STEP = 0.05  # rad or m that a joint is moved


class _Life:
    """A robot that is read a hundred times a second, with its own clock."""

    def __init__(self, robot: Robot, live: Callable[[float], None]) -> None:
        self._robot, self._live, self._now_s = robot, live, 0.0

    def read(self, seconds: float = 0.0) -> Reading:
        """Return the reading after so many seconds."""
        for _ in range(round(seconds / _PERIOD_S)):
            self._once()
        return self._once()

    def _once(self) -> Reading:
        self._now_s += _PERIOD_S
        self._live(self._now_s)
        return self._robot.read(self._now_s)


def check_driver(
    robot: Robot,
    live: Callable[[float], None] = lambda now_s: None,
    *,
    tolerance: float = 5e-3,
    settle_s: float = 2.0,
) -> None:
    """Raise AssertionError with the reason if ``robot`` violates the contract; it is closed afterwards.

    ``live`` is called before each reading with the time in s, to move whatever moves by itself. A joint that was
    commanded to move must be within ``tolerance`` (rad or m) after ``settle_s``.
    """
    life = _Life(robot, live)
    try:
        _check_facts(robot)
        _check_reading(robot, life.read())
        joint = _a_commanded(robot)
        _check_limits(robot, life, joint)
        robot.stop()
        life.read(settle_s)
        _check_motion(robot, life, joint, tolerance, settle_s)
    finally:
        robot.close()


def _check_facts(robot: Robot) -> None:
    facts = robot.describe()
    assert facts == robot.describe(), "describe() never changes"
    assert facts.title, "a robot has a title for people"
    told = {joint.name: joint for joint in joints_of(facts.urdf)}
    assert facts.joints, "a robot has joints"
    for joint in facts.joints:
        assert joint.name in told, f"{joint.name} is not a movable joint of the URDF"
        assert joint.linear == told[joint.name].linear, f"{joint.name} is of another kind in the URDF"
    assert len({joint.name for joint in facts.joints}) == len(facts.joints), "no joint is there twice"


def _check_reading(robot: Robot, reading: Reading) -> None:
    facts = robot.describe()
    for row in ("positions", "velocities", "efforts"):
        values = getattr(reading, row)
        assert len(values) == len(facts.joints), f"{row} has one value for each joint, in the order of Facts.joints"
        assert not any(math.isinf(value) for value in values), f"{row}: unknown is NaN, not infinite"
    assert (reading.base is not None) == facts.floating, "a base is measured exactly where one floats"


def _a_commanded(robot: Robot) -> JointFacts:
    found = [joint for joint in robot.describe().joints if joint.mimics is None]
    assert found, "a robot has a joint that takes setpoints"
    return found[0]


def _coupled(robot: Robot, life: _Life, joint: JointFacts, setpoint: float) -> dict[str, float]:
    """Return setpoints for a joint and those that take setpoints only with it, which stay where they are."""
    facts = robot.describe()
    at = dict(zip((each.name for each in facts.joints), life.read().positions, strict=True))
    group = next((group for group in facts.coupled if joint.name in group), ())
    return {name: at[name] for name in group} | {joint.name: setpoint}


def _check_limits(robot: Robot, life: _Life, joint: JointFacts) -> None:
    with pytest.raises(ValueError, match=joint.name):
        robot.apply({joint.name: math.nan})
    for beyond in (joint.limits.upper, joint.limits.lower):
        if beyond is not None:
            asked = beyond + math.copysign(1e6, beyond - _middle(joint))
            applied = robot.apply(_coupled(robot, life, joint, asked))
            assert applied[joint.name] == pytest.approx(beyond), "apply() keeps within the limits, and says so"


def _check_motion(robot: Robot, life: _Life, joint: JointFacts, tolerance: float, settle_s: float) -> None:
    names = [each.name for each in robot.describe().joints]
    before = life.read().positions
    at = before[names.index(joint.name)]
    if math.isnan(at):
        return  # without a position sensor its motion cannot be observed
    target = at + _STEP if joint.limits.clamp(at + _STEP) == at + _STEP else at - _STEP
    asked = _coupled(robot, life, joint, target)
    assert robot.apply(asked) == pytest.approx(asked), "what was applied is returned"
    after = life.read(settle_s).positions
    assert after[names.index(joint.name)] == pytest.approx(target, abs=tolerance), f"{joint.name} did not get there"
    for name, was, now in zip(names, before, after, strict=True):
        follows = {each.name for each in robot.describe().joints if each.mimics == joint.name}
        if name != joint.name and name not in follows and not math.isnan(was):
            assert now == pytest.approx(was, abs=tolerance), f"{name} was told nothing and moved"
    robot.stop()
    robot.stop()
    held = life.read(settle_s).positions[names.index(joint.name)]
    assert held == pytest.approx(target, abs=tolerance), "stop() holds the robot where it is"


def _middle(joint: JointFacts) -> float:
    known = [limit for limit in (joint.limits.lower, joint.limits.upper) if limit is not None]
    return sum(known) / len(known) if len(known) == 2 else 0.0
