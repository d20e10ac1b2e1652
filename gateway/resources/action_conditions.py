"""Conditions of the robot at hand under which a thing offers a kind of action, beside its class and capability."""

from collections.abc import Callable

from pyoxigraph import NamedNode

from gateway.fleet.model import Joint
from gateway.fleet.robot import Robot
from gateway.rdf.vocabulary import LF
from gateway.resources.named_poses import poses
from gateway.resources.shape_parameters import bounded, commandable, moved_links

Condition = Callable[[Robot, Joint | None], bool]


def is_bounded(robot: Robot, joint: Joint | None) -> bool:
    """Return True for a joint with limits whose commands the agent takes: those that its frames carry."""
    listed = robot.description.joints if robot.description is not None else ()
    return joint is not None and bounded(joint) and joint.name in listed


def has_commandable_joint(robot: Robot, joint: Joint | None) -> bool:
    """Return True if any joint of the robot can be commanded. The condition of kinds that have no other."""
    return bool(commandable(robot))


CONDITIONS: dict[NamedNode, Condition] = {
    LF.Rotate: is_bounded,
    LF.Translate: is_bounded,
    LF.RotateBy: is_bounded,
    LF.TranslateBy: is_bounded,
    LF.Hold: lambda _, joint: joint is not None and joint.commandable,
    LF.Reach: lambda robot, _: bool(moved_links(robot)),
    LF.AssumePose: lambda robot, _: bool(poses(robot)),
    LF.StopRobot: lambda robot, _: True,
}
