"""Paths of the resource tree: the only place where they are built from names and parsed (docs/TREE.md)."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from linked_fleet_agent.wire.keys import escape, unescape
from linked_fleet_base.contributions import present
from linked_fleet_state.model import RobotModel
from linked_fleet_state.robot import Robot

_LINK_MARK = "~link"  # no escape, because "~l" is not followed by hexadecimal digits; so it cannot be part of a name

_PART_MARK = "~part"  # likewise

# A robot has over a hundred parts, each named in every description of it, and a fleet names all robots in turn. A cache
# too small for all of them would never hit.
_segment, _name = lru_cache(maxsize=32_768)(escape), lru_cache(maxsize=32_768)(unescape)


def reserved_at_root() -> frozenset[str]:
    """Return the segments below ``/`` that are not robots."""
    return present().at_root


def reserved_in_robot() -> frozenset[str]:
    """Return the segments below a robot that are not joints or links."""
    return present().in_robot


def robot_path(robot: str) -> str:
    """Return the path of a robot, with a slash at its end."""
    return f"/{_segment(robot, present().at_root)}/"


def robot_name(segment: str) -> str:
    """Return the name of a robot's segment. Raises ValueError if it is reserved or malformed."""
    return _name(segment, present().at_root)


def robot_of(path: str) -> str | None:
    """Return the robot whose resource is at ``path``; None for a resource of the fleet."""
    try:
        segment, slash, _ = path[1:].partition("/")
        return robot_name(segment) if slash else None
    except ValueError:
        return None


def is_public(path: str) -> bool:
    """Return True if the resource at ``path`` contains nothing about a fleet: everybody may read it."""
    return path in ("/vocabulary", "/context") or is_shared(path)


def is_shared(path: str) -> bool:
    """Return True if the response is the same for everybody, so that shared caches may store it."""
    return path[1:].partition("/")[0] in present().public


def lease_path(robot: str) -> str:
    """Return the path of the control lease of a robot."""
    return robot_path(robot) + "lease"


def joint_path(robot: str, joint: str) -> str:
    """Return the path of a joint, without a slash at its end."""
    return robot_path(robot) + _segment(joint, present().in_robot)


def link_path(robot: str, model: RobotModel, link: str) -> str:
    """Return the path of a link. A link that shares its name with a joint gets a mark."""
    return robot_path(robot) + _segment(link, present().in_robot) + (_LINK_MARK if link in model.joints else "")


def part_path(robot: str, model: RobotModel, part: str) -> str:
    """Return the path of a part that is neither joint nor link. One that shares its name with them gets a mark."""
    shared = part in model.joints or part in model.links
    return robot_path(robot) + _segment(part, present().in_robot) + (_PART_MARK if shared else "")


def owner_path(path: str) -> str:
    """Return the path of the fleet, robot, or part of a robot at or above the existing resource at ``path``."""
    robot, *rest = path[1:].split("/")
    if not rest or robot in present().at_root:
        return "/"
    return f"/{robot}/" if rest[0] == "" or rest[0] in present().in_robot else f"/{robot}/{rest[0]}"


def is_below(path: str, root: str) -> bool:
    """Return True if ``path`` equals ``root`` or is below it."""
    return path == root or path.startswith(root.rstrip("/") + "/")


def thing_at(path: str, robots: Mapping[str, Robot]) -> tuple[Robot, Any] | None:
    """Return the robot at a path, or the robot and its part at a path: a joint, link or ``Part``; None if neither is
    there.
    """
    head, _, part = path[1:].partition("/")
    try:
        robot = robots.get(robot_name(head))
        if robot is None or (part and robot.model is None):
            return None
        if not part or robot.model is None:
            return (robot, None) if path.endswith("/") else None
        if (added := robot.parts.get(part)) is not None:
            return robot, added
        joint, link = joint_or_link(part, robot.model)
    except ValueError:
        return None
    return robot, robot.model.links[link or ""] if joint is None else robot.model.joints[joint]


def joint_or_link(segment: str, model: RobotModel) -> tuple[str | None, str | None]:
    """Return (joint, None) or (None, link) for a segment of ``model``. Raises ValueError if it is neither."""
    name = _name(segment.removesuffix(_LINK_MARK), present().in_robot)
    marked = segment.endswith(_LINK_MARK)
    if name in model.joints and not marked:
        return name, None
    if name in model.links and marked == (name in model.joints):
        return None, name
    raise ValueError(f"{segment!r} is neither a joint nor a link")
