"""The objects that requests of motions name: what a hand may touch (``lf:mayTouch``), and what a gripper grasps."""

from collections.abc import Mapping

from linked_fleet_gateway.api import ActionRequest, Conflict, Motion, NamedNode, UnprocessableContent
from linked_fleet_gateway.extensions.world.descriptions import OBJECTS
from linked_fleet_gateway.extensions.world.hands import grippers
from linked_fleet_gateway.extensions.world.held import FARTHEST_M, gap_m, in_hand
from linked_fleet_gateway.extensions.world.placement import LF
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.faces import View, robot_path

Objects = Mapping[str, SceneObject]


def things_to_touch(motion: Motion, objects: Objects, sees: View) -> tuple[str, ...]:
    """Return the ids of the objects that the hand may touch in a motion. Raises UnprocessableContent."""
    return _named(motion, LF.mayTouch, objects, sees)


def thing_to_grasp(motion: Motion, objects: Objects, sees: View) -> str:
    """Return the id of the object that an action of a gripper grasps, empty for none.

    Raises UnprocessableContent, and Conflict if the object is too far away, or it is unknown where it is in the hand.
    """
    named = _named(motion, LF.object, objects, sees)
    if not named or (request := motion.request) is None:
        return ""
    robot, thing = motion.robot, objects[named[0]]
    segment = request.thing.removeprefix(robot_path(robot.name))
    gripper = grippers(robot).get(segment)
    held = None if gripper is None else in_hand(robot, gripper, segment, thing)
    if held is None:
        raise Conflict(
            f"It is unknown where {thing.title} is in the hand of {robot.name}, whose place in the world is unknown: "
            "PUT its placement, or leave the object out."
        )
    if (gap := gap_m(held, thing.geometry)) > FARTHEST_M:
        raise Conflict(
            f"{thing.title} is {gap:.2f} m away from {held.link} of {robot.name}, and a gripper grasps what is within "
            f"{FARTHEST_M:g} m: move there first, or PUT the position of {thing.title}."
        )
    return named[0]


def _named(motion: Motion, predicate: NamedNode, objects: Objects, sees: View) -> tuple[str, ...]:
    if (request := motion.request) is None:
        return ()
    named = request.body.nodes(request.body.root, predicate)
    return tuple(dict.fromkeys(_id(motion, request, each, objects, sees) for each in named))


def _id(motion: Motion, request: ActionRequest, node: object, objects: Objects, sees: View) -> str:
    said = node.value if isinstance(node, NamedNode) else ""
    id = said.removeprefix(f"{request.base}{OBJECTS}/")
    thing = objects.get(id)
    if thing is None:
        raise UnprocessableContent(
            f"<{said[:200]}> is not an object of the world; hands touch what {request.base}{OBJECTS} contains."
        )
    if thing.kind == "zone":
        raise UnprocessableContent(f"{thing.title} is a lf:KeepOutZone, which no robot may enter.")
    if thing.held is not None and not sees.includes(thing.held.robot):
        raise UnprocessableContent(f"Another robot, which you may not see, holds {thing.title}.")
    return id
