"""What a joint's action admits, and the command that follows from it."""

import math

import pytest
from pyoxigraph import NamedNode

from agents.wire.codec import encode_state, layout
from agents.wire.messages import Description, State
from gateway.fleet.events import Appeared, Described, Framed
from gateway.fleet.fleet import Fleet
from gateway.fleet.model import Joint, RobotModel
from gateway.fleet.robot import Robot
from gateway.graph.actions import JointMotion, bounds
from gateway.graph.kinds import DEGREE, METRE, MILLIMETRE, RADIAN

_LIMIT = '<limit lower="{}" upper="{}" velocity="1" effort="1"/>'
_URDF = """<robot name="r"><link name="a"/><link name="b"/>
<joint name="j" type="{kind}"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{limit}</joint></robot>"""


def _robot(kind: str, limit: str, position: float) -> tuple[Robot, Joint]:
    urdf = _URDF.format(kind=kind, limit=limit)
    fleet = Fleet()
    described = Description(
        version=1, robot="r", incarnation=1, title="r", urdf=urdf, joints=("j",), rate_hz=100, layout=layout(1, False)
    )
    state = State(
        incarnation=1, sequence=1, monotonic_ns=1, wall_ns=1, positions=(position,), velocities=(0.0,), efforts=(0.0,)
    )
    for event in (Appeared("r", 1), Described(described), Framed("r", encode_state(state))):
        fleet.apply(event, 1)
    return fleet.robots["r"], RobotModel.parse(urdf).joints["j"]


@pytest.mark.parametrize("unit", [DEGREE, RADIAN])
@pytest.mark.parametrize(("low", "high"), [(-2.147, 1.047), (-math.pi, math.pi), (-1e-7, 1e-7), (0.1, 0.2)])
def test_admitted_bounds_lie_within_the_limits(low: float, high: float, unit: object) -> None:
    """Whatever unit states the bound, the command of an admitted value is within the URDF limit of the joint."""
    robot, joint = _robot("revolute", _LIMIT.format(low, high), 0.0)
    assert unit in (DEGREE, RADIAN)
    for value in bounds(joint, unit):  # type: ignore[arg-type]
        iri = unit.qudt  # type: ignore[attr-defined]
        target = JointMotion(robot, joint, "rotate").motion(value, iri).targets["j"]
        assert low <= target <= high


@pytest.mark.parametrize("present", [0.0, 3.0, -3.0, 100.0])
@pytest.mark.parametrize("degrees", [0.0, 10.0, 180.0, 350.0])
def test_a_continuous_joint_takes_the_short_way(present: float, degrees: float) -> None:
    """At most half a turn from where it is, to an angle equal to the stated one."""
    robot, joint = _robot("continuous", "", present)
    target = JointMotion(robot, joint, "rotate").motion(degrees, DEGREE.qudt).targets["j"]
    assert abs(target - present) <= math.pi + 1e-9
    assert math.cos(target - math.radians(degrees)) == pytest.approx(1)


def test_millimetres_are_metres() -> None:
    """30 mm command 0.03 m."""
    robot, joint = _robot("prismatic", _LIMIT.format(0, 0.04), 0.0)
    motion = JointMotion(robot, joint, "translate")
    assert motion.motion(30, MILLIMETRE.qudt).targets["j"] == pytest.approx(0.03)
    assert bounds(joint, MILLIMETRE) == (0, 40)
    assert bounds(joint, METRE) == (0, 0.04)


def test_units_are_understood_in_every_namespace_that_is_listed() -> None:
    """maths:Degree, vom:Degree and unit:DEG are one unit."""
    robot, joint = _robot("revolute", _LIMIT.format(-1, 1), 0.0)
    targets = {JointMotion(robot, joint, "rotate").motion(10, iri).targets["j"] for iri in DEGREE.accepted}
    assert targets == {math.radians(10)}
    assert all(isinstance(iri, NamedNode) for iri in DEGREE.accepted)
