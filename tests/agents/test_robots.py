"""The contract of a robot, for each robot of the catalogue."""

import math

import pytest

from linked_fleet_agent.robot import Robot
from linked_fleet_agent.robots.catalogue import MODELS, load
from linked_fleet_agent.robots.mujoco_robot import MujocoRobot

PERIOD_S = 0.01


@pytest.fixture(params=sorted(MODELS))
def robot(request: pytest.FixtureRequest) -> Robot:
    return load(request.param, request.param)


@pytest.fixture(params=sorted(name for name, model in MODELS.items() if model.home))
def jointed(request: pytest.FixtureRequest) -> Robot:
    """Return each robot with joints that take commands."""
    return load(request.param, request.param)


def _run(robot: Robot, begin_s: float, seconds: float) -> list[float]:
    """Advance and return the last positions."""
    positions: tuple[float, ...] = ()
    for step in range(round(seconds / PERIOD_S) + 1):
        positions = robot.read(begin_s + step * PERIOD_S).positions
    return list(positions)


def test_describe_matches_what_is_read(robot: Robot) -> None:
    """Every row has one value per joint, and a base is measured exactly where one floats."""
    facts, reading = robot.describe(), robot.read(0.0)
    rows = (reading.positions, reading.velocities, reading.efforts)
    assert {len(row) for row in rows} == {len(facts.joints)}
    assert (reading.base is not None) == facts.floating
    assert all(
        joint.limits.clamp(p) == pytest.approx(p) for joint, p in zip(facts.joints, reading.positions, strict=True)
    )


def test_holds_its_pose_against_gravity(robot: Robot) -> None:
    """Two seconds after the start no joint is off by more than 5 mrad or 5 mm."""
    start = _run(robot, 0.0, 0.0)
    assert _run(robot, 0.0, 2.0) == pytest.approx(start, abs=5e-3)


def test_apply_reaches_its_target_and_stop_holds(jointed: Robot) -> None:
    """A small step is reached and returned, and stop keeps it."""
    facts, start = jointed.describe(), _run(jointed, 0.0, 0.0)
    index = next(i for i, joint in enumerate(facts.joints) if not (joint.mimics or joint.linear or joint.passive))
    joint = facts.joints[index]
    target = joint.limits.clamp(start[index] + 0.05)
    assert jointed.apply({joint.name: target}) == {joint.name: target}
    assert _run(jointed, 0.0, 2.0)[index] == pytest.approx(target, abs=5e-3)
    jointed.stop()
    jointed.stop()
    assert _run(jointed, 2.0, 1.0)[index] == pytest.approx(target, abs=5e-3)


def test_apply_says_what_the_limits_left(jointed: Robot) -> None:
    """The driver itself clamps a setpoint to its limit; a setpoint that is no number is refused."""
    joint = next(j for j in jointed.describe().joints if j.mimics is None and j.limits.upper is not None)
    assert jointed.apply({joint.name: 1e9}) == {joint.name: joint.limits.upper}
    with pytest.raises(ValueError, match=joint.name):
        jointed.apply({joint.name: math.nan})


def test_apply_leaves_a_joint_outside_its_limits_where_it_stands() -> None:
    """A person may have pushed it there. A setpoint at its place is applied, and one further out is not."""
    robot = load("arm", "panda")
    assert isinstance(robot, MujocoRobot)
    index, joint = next((i, each) for i, each in enumerate(robot.describe().joints) if each.limits.upper is not None)
    upper = joint.limits.upper
    assert upper is not None
    robot._data.qpos[robot._qpos[index]] = upper + 0.2
    for asked, applied in ((upper + 0.2, upper + 0.2), (upper + 0.1, upper + 0.1), (upper + 0.3, upper + 0.2)):
        assert robot.apply({joint.name: asked}) == {joint.name: pytest.approx(applied)}
    robot._data.qpos[robot._qpos[index]] = upper - 0.2
    assert robot.apply({joint.name: upper + 0.1}) == {joint.name: upper}


def test_a_stall_is_forgiven(robot: Robot) -> None:
    """A read that is an hour late advances by a bounded time, and later reads continue."""
    start = _run(robot, 0.0, 0.5)
    assert _run(robot, 3600.0, 0.5) == pytest.approx(start, abs=5e-3)


def test_a_standing_robot_stands() -> None:
    """Go2 is upright at about the height of its standing pose."""
    robot = load("dog", "go2")
    _run(robot, 0.0, 2.0)
    base = robot.read(2.01).base
    assert base is not None
    assert base.position_m[2] == pytest.approx(0.335, abs=0.01)
    assert base.orientation_xyzw[3] == pytest.approx(1.0, abs=1e-3)
