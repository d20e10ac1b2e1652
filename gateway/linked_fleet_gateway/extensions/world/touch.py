"""The objects that requests of motions name: what a hand may touch (``lf:mayTouch``), and what a gripper grasps."""

from collections.abc import Mapping

from linked_fleet_gateway.api import ActionRequest, Conflict, Motion, NamedNode, UnprocessableContent
from linked_fleet_gateway.extensions.world.descriptions import OBJECTS
from linked_fleet_gateway.extensions.world.placement import LF, has_placement
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.faces import View

Objects = Mapping[str, SceneObject]


def things_to_touch(motion: Motion, objects: Objects, sees: View) -> tuple[str, ...]:
    """Return the ids of the objects that the hand may touch in a motion. Raises UnprocessableContent."""
    return _named(motion, LF.mayTouch, objects, sees)


def thing_to_grasp(motion: Motion, objects: Objects, sees: View) -> str:
    """Return the id of the object that an action of a gripper grasps, empty for none.

    Raises UnprocessableContent, and Conflict if it is unknown where the object is in the hand.
    """
    found = _named(motion, LF.object, objects, sees)
    if found and not has_placement(motion.robot):
        raise Conflict(
            f"{motion.robot.name} has no placement in the world, so it is unknown where {objects[found[0]].title} is "
            "in its hand: PUT its placement, or leave the object out."
        )
    return found[0] if found else ""


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
    if thing.held is not None and thing.held.robot != motion.robot.name:
        holder = thing.held.robot if sees.includes(thing.held.robot) else "another robot"
        raise UnprocessableContent(f"{holder} holds {thing.title}, and no robot may touch another one.")
    return id
