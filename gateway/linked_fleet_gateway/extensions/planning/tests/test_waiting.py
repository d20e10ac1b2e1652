"""A motion that waits at its start is a trajectory that its agent accepts."""

import math

import pytest

from linked_fleet_agent.plan import Start, plan
from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.urdf.limits import Limits
from linked_fleet_agent.wire.messages import Move
from linked_fleet_gateway.extensions.planning.waiting import _CURVE_SHARE
from linked_fleet_gateway.extensions.world.course import course_of
from linked_fleet_gateway.extensions.world.questions import paths_of
from linked_fleet_state.events import Frames
from linked_fleet_state.model import RobotModel
from linked_fleet_state.robot import Robot

LIMITS = Limits(-3.0, 3.0, 2.0, 10.0)
URDF = """<robot name="arm"><link name="foot"/><link name="rod"/><link name="hand"/>
<joint name="turn" type="revolute"><parent link="foot"/><child link="rod"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="10"/></joint>
<joint name="bend" type="revolute"><parent link="rod"/><child link="hand"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="2" effort="10"/></joint></robot>"""


@pytest.fixture
def robot() -> Robot:
    made = Robot("arm", lambda name, error: None, Frames(str))
    made.model = RobotModel.for_urdf(URDF)
    return made


@pytest.mark.parametrize("scale", [1.0, 0.2])
@pytest.mark.parametrize("degrees", [3.0, 20.0, 170.0])
def test_it_stays_and_then_moves_as_its_agent_lets_it(robot: Robot, degrees: float, scale: float) -> None:
    move, start = Move({"turn": math.radians(degrees), "bend": 0.3}), {"turn": 0.0, "bend": 0.1}
    [direct] = paths_of(move, start, {})
    course = course_of(robot, move, _CURVE_SHARE * scale, direct.legs, start)
    assert course is not None
    planned = plan(course.after(2.5), scale, [Start(JointFacts(name, limits=LIMITS), start[name]) for name in start])
    assert planned.duration_s == pytest.approx(2.5 + course.duration_s)
    for name in start:
        trajectory = planned.trajectories[name]
        assert {trajectory.at(time_s) for time_s in (0.0, 1.0, 2.5)} == {(start[name], 0.0)}
        assert trajectory.at(planned.duration_s)[0] == pytest.approx(move.targets[name])
        assert trajectory.at(2.5 + course.duration_s / 2)[0] == pytest.approx((start[name] + move.targets[name]) / 2)
