"""The hands of a robot: which links may touch what is grasped, or held. Pure.

The hand of a gripper are the links that its joints move, and the link that carries these, with what is fixed to it. In
a robot without a gripper the links that the last joint of each arm carries are its hands.
"""

from collections.abc import Iterable, Iterator, Mapping

from linked_fleet_gateway.api import Joint, Robot, RobotModel
from linked_fleet_gateway.faces import parts_of
from linked_fleet_state.gripper import Gripper
from linked_fleet_state.model import JointKind


def grippers(robot: Robot) -> Mapping[str, Gripper]:
    """Return the grippers of a robot by the segments of their paths."""
    return {segment: found for segment, each in parts_of(robot).items() if (found := each.gripper) is not None}


def hands_of(robot: Robot) -> frozenset[str]:
    """Return the links of all hands of a robot."""
    if (model := robot.model) is None:
        return frozenset()
    found = grippers(robot).values()
    hands = [_whole(model, each) for each in found] or [_below(model, [each]) for each in _last(model, robot.commanded)]
    return frozenset().union(*hands)


def hand_around(robot: Robot, link: str) -> frozenset[str]:
    """Return the links that may touch what a link holds: those within one joint of it, and its gripper."""
    model = robot.model
    assert model is not None
    own = _fixed_to(model, link)
    found = own.union(*(_fixed_to(model, each) for each in _beside(model, own)))
    return found.union(*(hand for each in grippers(robot).values() if (hand := _whole(model, each)) & own))


def palm_of(model: RobotModel, gripper: Gripper) -> str:
    """Return the link that carries the fingers of a gripper; empty if it moves no joint of the model."""
    joints = [each for each in gripper.joints if each in model.joints]
    return model.joints[min(joints, key=lambda each: _depth(model, each))].parent if joints else ""


def _whole(model: RobotModel, gripper: Gripper) -> frozenset[str]:
    """Return the links of a gripper."""
    joints = {each for each in model.joints if _leader(model, each) in gripper.joints or each in gripper.joints}
    mounted = {palm_of(model, gripper), gripper.link} & model.links.keys()
    return _below(model, joints).union(*(_fixed_to(model, each) for each in mounted))


def _leader(model: RobotModel, joint: str) -> str:
    """Return the joint that a joint mimics in the end; itself if it mimics none."""
    for _ in model.joints:
        mimic = model.joints[joint].mimic
        if mimic is None or mimic.joint not in model.joints:
            break
        joint = mimic.joint
    return joint


def _last(model: RobotModel, joints: Iterable[str]) -> list[str]:
    """Return those of the joints that carry no other one of them."""
    known = [each for each in joints if each in model.joints]
    carrying = {above for each in known for above in _above(model, model.joints[each].parent)}
    return [each for each in known if each not in carrying]


def _above(model: RobotModel, link: str) -> Iterator[str]:
    while (joint := model.links[link].parent_joint) is not None:
        yield joint
        link = model.joints[joint].parent


def _depth(model: RobotModel, joint: str) -> int:
    return len(list(_above(model, model.joints[joint].parent)))


def _below(model: RobotModel, joints: Iterable[str]) -> frozenset[str]:
    """Return the links that joints carry, also by other joints."""
    pending, found = [model.joints[each].child for each in joints], set[str]()
    while pending:
        link = pending.pop()
        found.add(link)
        pending += [model.joints[each].child for each in model.links[link].child_joints]
    return frozenset(found)


def _fixed_to(model: RobotModel, link: str) -> frozenset[str]:
    """Return a link, and those that fixed joints connect to it."""
    pending, found = [link], set[str]()
    while pending:
        here = pending.pop()
        found.add(here)
        ends = (model.joints[each] for each in _joints_at(model, here))
        next_to = (each.child if each.parent == here else each.parent for each in ends if _is_fixed(each))
        pending += [each for each in next_to if each not in found]
    return frozenset(found)


def _beside(model: RobotModel, links: Iterable[str]) -> set[str]:
    """Return the links that one joint which moves connects to links."""
    joints = [(link, model.joints[each]) for link in links for each in _joints_at(model, link)]
    return {each.child if each.parent == link else each.parent for link, each in joints if not _is_fixed(each)}


def _joints_at(model: RobotModel, link: str) -> list[str]:
    above = model.links[link].parent_joint
    return [*model.links[link].child_joints, *([] if above is None else [above])]


def _is_fixed(joint: Joint) -> bool:
    return joint.kind is JointKind.FIXED
