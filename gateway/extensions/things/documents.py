"""What things and properties are for neighbours that speak no RDF: Thing Descriptions, and plain JSON.

Nothing is imported, and nothing written, before somebody asks for it.
"""

from collections.abc import Callable
from functools import partial

from gateway.fleet.model import Joint, Link
from gateway.fleet.robot import Robot
from gateway.resources.extension import Sight

TD = "application/td+json"
DIRECTORY, MOST = "/things", 50
"""Path of the directory of Thing Descriptions, and the most that one page of it has."""
Documents = dict[str, Callable[[], bytes]]


def of_thing(sight: Sight, robot: Robot | None = None, part: Joint | Link | None = None) -> Documents:
    """The Thing Description of the fleet, a robot, or a part of it."""
    return {TD: partial(_thing_description, sight, robot, part)}


def _thing_description(sight: Sight, robot: Robot | None, part: Joint | Link | None) -> bytes:
    from gateway.extensions.things.td import Thing, thing_description

    return thing_description(Thing(sight.base, sight.secured, robot, part), sight.robots)
