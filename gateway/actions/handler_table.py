"""Which function answers which kind of action, and which things can offer it. A new kind is one more line."""

from collections.abc import Callable
from dataclasses import dataclass

from pyoxigraph import NamedNode

from gateway.actions import action_handlers as motions
from gateway.actions.action_request import Asked
from gateway.actions.plan import Plan
from gateway.fleet.model import Joint
from gateway.fleet.robot import Robot
from gateway.rdf.vocabulary import LF
from gateway.resources.named_poses import poses
from gateway.resources.shape_parameters import bounded, commandable, moved_links


def _bounded_joint(robot: Robot, joint: Joint | None) -> bool:
    """Also that the agent takes commands for it: those that its frames carry."""
    listed = robot.description.joints if robot.description is not None else ()
    return joint is not None and bounded(joint) and joint.name in listed


def _any_joint(robot: Robot, joint: Joint | None) -> bool:
    return bool(commandable(robot))


@dataclass(frozen=True)
class Handler:
    """``plan`` says what is to be done and does nothing; ``offered`` whether a thing of the right class can do it."""

    plan: Callable[[Asked], Plan]
    offered: Callable[[Robot, Joint | None], bool] = _any_joint


HANDLERS: dict[NamedNode, Handler] = {
    LF.Rotate: Handler(motions.to_position, _bounded_joint),
    LF.Translate: Handler(motions.to_position, _bounded_joint),
    LF.RotateBy: Handler(motions.by_distance, _bounded_joint),
    LF.TranslateBy: Handler(motions.by_distance, _bounded_joint),
    LF.Hold: Handler(motions.hold, lambda _, joint: joint is not None and joint.commandable),
    LF.MoveJoints: Handler(motions.move_joints),
    LF.FollowTrajectory: Handler(motions.follow),
    LF.Reach: Handler(motions.reach, lambda robot, _: bool(moved_links(robot))),
    LF.AssumePose: Handler(motions.assume_pose, lambda robot, _: bool(poses(robot))),
    LF.StopRobot: Handler(motions.stop, lambda robot, _: True),
    LF.StopAll: Handler(motions.stop_all),
}
