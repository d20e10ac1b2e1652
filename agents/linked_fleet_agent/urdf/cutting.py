"""Cuts parts out of a model: a robot of which only the base is wanted. Pure."""

from collections.abc import Collection
from dataclasses import replace

from linked_fleet_agent.urdf.model import RobotModel


def without(model: RobotModel, joints: Collection[str], name: str) -> RobotModel:
    """Return a model called ``name`` without these joints and all that hangs on them.

    Raises KeyError for a joint that it does not have.
    """
    cut, below = {model.joints[joint].child for joint in joints}, [model.joints[joint].child for joint in joints]
    while below:
        children = [model.joints[joint].child for joint in model.links[below.pop()].child_joints]
        cut.update(children)
        below += children
    kept = {key: joint for key, joint in model.joints.items() if joint.child not in cut}
    links = {
        key: replace(link, child_joints=tuple(joint for joint in link.child_joints if joint in kept))
        for key, link in model.links.items()
        if key not in cut
    }
    return replace(model, name=name, joints=kept, links=links, findings=())
