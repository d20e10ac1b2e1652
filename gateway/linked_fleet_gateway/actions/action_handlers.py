"""The handlers of all actions, which convert a validated body into a plan. Pure."""

import math
from collections.abc import Mapping

from linked_fleet_agent.wire.messages import Expectation, Follow, Move
from linked_fleet_gateway.actions.plan import ActionRequest, Halt, Motion
from linked_fleet_gateway.base.errors import Conflict, UnprocessableContent
from linked_fleet_gateway.fleet.model import Joint, JointKind
from linked_fleet_gateway.rdf.graph import Node
from linked_fleet_gateway.rdf.vocabulary import LF
from linked_fleet_gateway.resources.named_poses import poses

_SETTLING = 2e-4  # rad or m: a joint at its limit may be measured this far beyond it

# -- joint ----------------------------------------------------------------------------------------------------------


def to_position(asked: ActionRequest) -> Motion:
    """Handle ``rotate`` and ``translate``."""
    joint = asked.of_joint()
    target = _near(asked, joint, asked.body.quantity(asked.body.root))
    return motion_to(asked, Move({joint.name: target}, _speeds(asked, joint)), {joint.name: target})


def by_distance(asked: ActionRequest) -> Motion:
    """Handle ``rotateBy`` and ``translateBy`` from the present position.

    Raises Conflict if it would leave the limits.
    """
    joint = asked.of_joint()
    target = _present(asked, joint) + asked.body.quantity(asked.body.root)
    low, high = joint.limits.lower, joint.limits.upper
    if joint.kind is not JointKind.CONTINUOUS:
        if low is None or high is None or not low - _SETTLING <= target <= high + _SETTLING:
            raise Conflict(f"{joint.name} would end at {target:.6g}, outside its limits {low} to {high} (SI units).")
        target = min(max(target, low), high)
    return motion_to(asked, Move({joint.name: target}, _speeds(asked, joint)), {joint.name: target})


def hold(asked: ActionRequest) -> Halt:
    return Halt((asked.of_robot().name,), (asked.of_joint().name,))


# -- robot ----------------------------------------------------------------------------------------------------------


def move_joints(asked: ActionRequest) -> Motion:
    joints = asked.model().joints
    targets = {name: _near(asked, joints[name], value) for name, value in _targets(asked, asked.body.root).items()}
    return motion_to(asked, Move(targets), targets)


def follow(asked: ActionRequest) -> Motion:
    """Handle ``followTrajectory``: waypoints in temporal order, all with the same joints."""
    body = asked.body
    waypoints = sorted(
        ((body.number(each, LF.atTime) or 0.0, each) for each in body.nodes(body.root, LF.waypoint)),
        key=lambda each: each[0],
    )
    times = tuple(time for time, _ in waypoints)
    if len(set(times)) < len(times):
        raise UnprocessableContent("Two waypoints have the same lf:atTime; each needs its own.")
    rows: list[tuple[float, ...]] = []
    known = asked.model().joints
    joints: list[str] = []
    before: dict[str, float] = {}
    for time, waypoint in waypoints:
        targets = _targets(asked, waypoint)
        joints = joints or list(targets)
        if set(targets) != set(joints):
            raise UnprocessableContent(
                f"The waypoint at {time:g} s names other joints than the first; all name the same."
            )
        before = {name: _near(asked, known[name], targets[name], before.get(name)) for name in joints}
        rows.append(tuple(before[name] for name in joints))
    return motion_to(asked, Follow(tuple(joints), times, tuple(rows)), before)


def assume_pose(asked: ActionRequest) -> Motion:
    name = asked.body.text(asked.body.root, LF.poseName)
    assert name is not None
    joints = asked.model().joints
    targets = {joint: _near(asked, joints[joint], value) for joint, value in poses(asked.of_robot())[name].items()}
    return motion_to(asked, Move(targets), targets)


def stop(asked: ActionRequest) -> Halt:
    return Halt((asked.of_robot().name,))


# -- fleet ----------------------------------------------------------------------------------------------------------


def stop_all(asked: ActionRequest) -> Halt:
    return Halt(None)


# -- pieces ---------------------------------------------------------------------------------------------------------


def motion_to(asked: ActionRequest, motion: Move | Follow, targets: Mapping[str, float]) -> Motion:
    """Return the motion with the optional members that every body may have."""
    body, robot = asked.body, asked.of_robot()
    scale = body.number(body.root, LF.speedScale)
    if scale is not None and not 0 < scale <= 1:  # a shape of an extension may not have checked it
        raise UnprocessableContent(f"lf:speedScale is above 0 and at most 1, not {scale:g}.")
    preconditions = body.nodes(body.root, LF.precondition)
    expects = dict(_expectation(asked, node) for node in preconditions)
    if len(expects) < len(preconditions):
        raise UnprocessableContent("Two preconditions name the same joint; each joint is in one place.")
    tied = body.node(body.root, LF.tiedTo) is not None
    return Motion(robot, motion, targets, asked.of_moment(), min(scale or 1.0, robot.speed_scale), expects, tied)


def _expectation(asked: ActionRequest, node: Node) -> tuple[str, Expectation]:
    body = asked.body
    tolerance = body.number(node, LF.tolerance)
    assert tolerance is not None
    joint = asked.joint_at(body.node(node, LF.ofJoint))
    return joint.name, Expectation(body.quantity(node), tolerance * body.unit(node))


def _targets(asked: ActionRequest, node: Node) -> dict[str, float]:
    """Return the positions that ``node`` states, by joint (rad or m).

    Raises UnprocessableContent for a repeated joint.
    """
    body, found = asked.body, dict[str, float]()
    for target in body.nodes(node, LF.target):
        joint = asked.joint_at(body.node(target, LF.ofJoint)).name
        if joint in found:
            raise UnprocessableContent(f"Two targets name {joint}; each joint has one at a time.")
        found[joint] = body.quantity(target)
    return found


def _speeds(asked: ActionRequest, joint: Joint) -> dict[str, float]:
    speed = asked.body.node(asked.body.root, LF.speed)
    return {} if speed is None else {joint.name: asked.body.quantity(speed)}


def _near(asked: ActionRequest, joint: Joint, target: float, start: float | None = None) -> float:
    """Return the target clamped to the limits, against rounding by units; for a continuous joint the nearest turn."""
    if joint.kind is JointKind.CONTINUOUS:
        start = _present(asked, joint) if start is None else start
        return start + math.remainder(target - start, math.tau)
    low, high = joint.limits.lower, joint.limits.upper
    return target if low is None or high is None else min(max(target, low), high)


def _present(asked: ActionRequest, joint: Joint) -> float:
    position = asked.of_robot().positions.get(joint.name, math.nan)
    if math.isnan(position):
        raise Conflict(f"The position of {joint.name} is unknown at present; nothing can be planned from there.")
    return position
