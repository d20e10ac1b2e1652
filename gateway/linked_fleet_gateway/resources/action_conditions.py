"""Conditions on the robot under which a thing offers a kind of action (``lf:offeredIf``)."""

from collections.abc import Callable

from pyoxigraph import NamedNode

from linked_fleet_gateway.fleet.model import Joint
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.vocabulary import LF
from linked_fleet_gateway.resources.named_poses import poses
from linked_fleet_gateway.resources.shape_parameters import bounded, commandable, moved_links

Condition = Callable[[Robot, Joint | None], bool]


def _is_bounded(robot: Robot, joint: Joint | None) -> bool:
    """Return True for a joint that has limits and is in the agent's frames, which means that it takes commands."""
    listed = robot.description.joints if robot.description is not None else ()
    return joint is not None and bounded(joint) and joint.name in listed


CONDITIONS: dict[NamedNode, Condition] = {
    LF.isBounded: _is_bounded,
    LF.isCommandable: lambda robot, joint: joint is not None and joint.commandable,
    LF.hasCommandableJoint: lambda robot, joint: bool(commandable(robot)),
    LF.hasMovedLink: lambda robot, joint: bool(moved_links(robot)),
    LF.hasNamedPose: lambda robot, joint: bool(poses(robot)),
}
