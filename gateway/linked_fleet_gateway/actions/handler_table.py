"""The handler of each kind of action. A handler converts a validated body into a plan, without side effects."""

from collections.abc import Callable

from pyoxigraph import NamedNode

from linked_fleet_gateway.actions import action_handlers as handlers
from linked_fleet_gateway.actions.plan import ActionRequest, Plan
from linked_fleet_gateway.rdf.vocabulary import LF

Handler = Callable[[ActionRequest], Plan]

HANDLERS: dict[NamedNode, Handler] = {
    LF.Rotate: handlers.to_position,
    LF.Translate: handlers.to_position,
    LF.RotateBy: handlers.by_distance,
    LF.TranslateBy: handlers.by_distance,
    LF.Hold: handlers.hold,
    LF.MoveJoints: handlers.move_joints,
    LF.FollowTrajectory: handlers.follow,
    LF.AssumePose: handlers.assume_pose,
    LF.StopRobot: handlers.stop,
    LF.StopAll: handlers.stop_all,
}
