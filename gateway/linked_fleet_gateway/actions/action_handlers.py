"""The handlers of all kinds of actions. Each converts a validated body into a plan, without side effects. Pure."""

import math
from collections.abc import Callable, Mapping

from pyoxigraph import NamedNode

from linked_fleet_agent.wire.messages import Expectation, Follow, Move
from linked_fleet_base.errors import Conflict, UnprocessableContent
from linked_fleet_gateway.actions.operations import Operation
from linked_fleet_gateway.actions.plan import ActionRequest, DeferredPlan, Halt, Motion
from linked_fleet_gateway.resources.annotations import named_poses
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.model import Joint, JointKind

_SETTLING = 2e-4  # rad or m: a joint at its limit may be measured this far beyond it

# -- joint ----------------------------------------------------------------------------------------------------------


def move_to_position(request: ActionRequest) -> Motion:
    """Handle ``rotate`` and ``translate``."""
    joint = request.required_joint()
    target = _near(request, joint, request.body.quantity(request.body.root))
    return build_motion(request, Move({joint.name: target}, _speeds(request, joint)), {joint.name: target})


def move_by_distance(request: ActionRequest) -> Motion:
    """Handle ``rotateBy`` and ``translateBy`` from the present position.

    Raises Conflict if it would leave the limits.
    """
    joint = request.required_joint()
    target = _present(request, joint) + request.body.quantity(request.body.root)
    low, high = joint.limits.lower, joint.limits.upper
    if joint.kind is not JointKind.CONTINUOUS:
        if low is None or high is None or not low - _SETTLING <= target <= high + _SETTLING:
            raise Conflict(f"{joint.name} would end at {target:.6g}, outside its limits {low} to {high} (SI units).")
        target = min(max(target, low), high)
    return build_motion(request, Move({joint.name: target}, _speeds(request, joint)), {joint.name: target})


def hold_joint(request: ActionRequest) -> Halt:
    return Halt((request.required_robot().name,), (request.required_joint().name,))


# -- robot ----------------------------------------------------------------------------------------------------------


def move_joints(request: ActionRequest) -> Motion:
    joints = request.model().joints
    targets = {
        name: _near(request, joints[name], value) for name, value in _targets(request, request.body.root).items()
    }
    return build_motion(request, Move(targets), targets)


def follow_trajectory(request: ActionRequest) -> Motion:
    """Handle ``followTrajectory``: waypoints in temporal order, all with the same joints."""
    body = request.body
    waypoints = sorted(
        ((body.number(each, LF.atTime) or 0.0, each) for each in body.nodes(body.root, LF.waypoint)),
        key=lambda each: each[0],
    )
    times = tuple(time for time, _ in waypoints)
    if len(set(times)) < len(times):
        raise UnprocessableContent("Two waypoints have the same lf:atTime; each needs its own.")
    rows: list[tuple[float, ...]] = []
    known = request.model().joints
    joints: list[str] = []
    before: dict[str, float] = {}
    for time, waypoint in waypoints:
        targets = _targets(request, waypoint)
        joints = joints or list(targets)
        if set(targets) != set(joints):
            raise UnprocessableContent(
                f"The waypoint at {time:g} s names other joints than the first; all name the same."
            )
        before = {name: _near(request, known[name], targets[name], before.get(name)) for name in joints}
        rows.append(tuple(before[name] for name in joints))
    return build_motion(request, Follow(tuple(joints), times, tuple(rows)), before)


def assume_pose(request: ActionRequest) -> Motion:
    name = request.body.text(request.body.root, LF.poseName)
    assert name is not None
    joints = request.model().joints
    targets = {
        joint: _near(request, joints[joint], value)
        for joint, value in named_poses(request.required_robot())[name].items()
    }
    return build_motion(request, Move(targets), targets)


def stop_robot(request: ActionRequest) -> Halt:
    return Halt((request.required_robot().name,))


# -- fleet ----------------------------------------------------------------------------------------------------------


def stop_all(request: ActionRequest) -> Halt:
    return Halt(None)


# -- pieces ---------------------------------------------------------------------------------------------------------


def build_motion(request: ActionRequest, motion: Move | Follow, targets: Mapping[str, float]) -> Motion:
    """Return the motion with the optional members that every body may have."""
    body, robot = request.body, request.required_robot()
    scale = body.number(body.root, LF.speedScale)
    if scale is not None and not 0 < scale <= 1:  # a shape of an extension may not have checked it
        raise UnprocessableContent(f"lf:speedScale is above 0 and at most 1, not {scale:g}.")
    preconditions = body.nodes(body.root, LF.precondition)
    expects = dict(_expectation(request, node) for node in preconditions)
    if len(expects) < len(preconditions):
        raise UnprocessableContent("Two preconditions name the same joint; each joint is in one place.")
    tied = body.node(body.root, LF.tiedTo) is not None
    scale = min(scale or 1.0, robot.speed_scale)
    return Motion(robot, motion, targets, request.required_time(), scale, expects, tied, request=request)


def _expectation(request: ActionRequest, node: Node) -> tuple[str, Expectation]:
    body = request.body
    tolerance = body.number(node, LF.tolerance)
    assert tolerance is not None
    joint = request.joint_at(body.node(node, LF.ofJoint))
    return joint.name, Expectation(body.quantity(node), tolerance * body.unit(node))


def _targets(request: ActionRequest, node: Node) -> dict[str, float]:
    """Return the positions that ``node`` states, by joint (rad or m).

    Raises UnprocessableContent for a repeated joint.
    """
    body, found = request.body, dict[str, float]()
    for target in body.nodes(node, LF.target):
        joint = request.joint_at(body.node(target, LF.ofJoint)).name
        if joint in found:
            raise UnprocessableContent(f"Two targets name {joint}; each joint has one at a time.")
        found[joint] = body.quantity(target)
    return found


def _speeds(request: ActionRequest, joint: Joint) -> dict[str, float]:
    speed = request.body.node(request.body.root, LF.speed)
    return {} if speed is None else {joint.name: request.body.quantity(speed)}


def _near(request: ActionRequest, joint: Joint, target: float, start: float | None = None) -> float:
    """Return the target clamped to the limits, against rounding by units; for a continuous joint the nearest turn."""
    if joint.kind is JointKind.CONTINUOUS:
        start = _present(request, joint) if start is None else start
        return start + math.remainder(target - start, math.tau)
    low, high = joint.limits.lower, joint.limits.upper
    return target if low is None or high is None else min(max(target, low), high)


def _present(request: ActionRequest, joint: Joint) -> float:
    position = request.required_robot().positions.get(joint.name, math.nan)
    if math.isnan(position):
        raise Conflict(f"The position of {joint.name} is unknown at present; nothing can be planned from there.")
    return position


Plan = Motion | Halt | DeferredPlan | Operation
Handler = Callable[[ActionRequest], Plan]

HANDLERS: dict[NamedNode, Handler] = {
    LF.Rotate: move_to_position,
    LF.Translate: move_to_position,
    LF.RotateBy: move_by_distance,
    LF.TranslateBy: move_by_distance,
    LF.Hold: hold_joint,
    LF.MoveJoints: move_joints,
    LF.FollowTrajectory: follow_trajectory,
    LF.AssumePose: assume_pose,
    LF.StopRobot: stop_robot,
    LF.StopAll: stop_all,
}
