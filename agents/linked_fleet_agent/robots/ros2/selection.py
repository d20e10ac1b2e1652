"""Which topics, services and actions of a ROS graph become parts of a robot. Pure.

Those that the configuration names, and those whose names match a pattern of ``expose`` and none of ``deny``.
"""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from fnmatch import translate
from typing import NamedTuple

from msgspec.structs import replace

from linked_fleet_agent.robots.ros2.configuration import (
    ActionEntry,
    Configuration,
    Entry,
    PropertyEntry,
    names_of,
)
from linked_fleet_agent.robots.ros2.graph import Offer, Role

DENIED_NAMES = (
    *("/parameter_events", "/rosout", "/clock", "/tf", "/tf_static", "/bond", "*/_action/*", "*/_service_event"),
    *("*/get_type_description", "*/describe_parameters", "*/get_parameters", "*/get_parameter_types"),
    *("*/list_parameters", "*/set_parameters", "*/set_parameters_atomically", "*/get_logger_levels"),
    *("*/set_logger_levels", "*/robot_description", "*/joint_states", "*/dynamic_joint_states", "*/transition_event"),
)
"""Names that patterns do not expose: what all nodes have, and what the driver itself uses."""
DENIED_TYPES = (
    *("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud*", "stereo_msgs/*"),
    *("nav_msgs/msg/OccupancyGrid", "map_msgs/*", "visualization_msgs/*", "trajectory_msgs/*", "tf2_msgs/*"),
    *("control_msgs/action/*", "nav2_msgs/action/*", "controller_manager_msgs/*"),
)
"""Types that patterns do not expose: what is too long for a value, and what moves the robot for sure."""
_SEND_GOAL, _GET_RESULT, _FEEDBACK = "/_action/send_goal", "/_action/get_result", "/_action/feedback"


class Selected(NamedTuple):
    """An entry with its type, and what peers state of it: hashes by type, and whether it is latched."""

    entry: Entry
    hashes: Mapping[str, str] = {}
    latched: bool = False

    @property
    def key(self) -> tuple[str, str, str]:
        """Its entry in the graph: kind, name and type."""
        return self.entry.kind, self.entry.ros_name, self.entry.type


class Selection(NamedTuple):
    """The entries that become parts of the robot, and sentences about entries that cannot yet."""

    selected: tuple[Selected, ...]
    missing: tuple[str, ...]


def select(configuration: Configuration, offers: Collection[Offer], namespace: str = "") -> Selection:
    """Return what of these offers becomes a part of the robot, and all entries that state their type."""
    selected, missing = list[Selected](), list[str]()
    for entry in configuration.entries:
        known = _completed(entry, offers)
        if known is None:
            what = {"msg": "topic", "srv": "service", "action": "action"}[entry.kind]
            missing.append(f"the {what} {entry.ros_name} is not there, and the configuration does not state its type")
        else:
            selected.append(known)
    named = {each.ros_name for each in configuration.entries}
    for entry in _matching(configuration, offers, namespace):
        if entry.ros_name not in named and (known := _completed(entry, offers)) is not None:
            selected.append(known)
    return Selection(tuple(selected), tuple(missing))


def _completed(entry: Entry, offers: Collection[Offer]) -> Selected | None:
    """Return an entry with the type and the hashes of its first peer; None if there is no peer, and no type stated."""
    if entry.kind == "action":
        return _completed_action(entry, offers)
    roles: tuple[Role, ...] = ("service",) if entry.kind == "srv" else ("publisher", "subscription")
    peers = [
        each
        for role in roles
        for each in offers
        if each.role == role and each.interface.name == entry.ros_name and entry.type in ("", each.interface.type)
    ]
    if not peers:
        return Selected(entry) if entry.type else None
    first = peers[0]
    latched = any(each.latched and each.role == "publisher" for each in peers)
    typed = replace(entry, type=first.interface.type)
    return Selected(typed, {typed.type: first.type_hash} if first.type_hash else {}, latched)


def _completed_action(entry: Entry, offers: Iterable[Offer]) -> Selected | None:
    """Return an action with its type, which is said by those of its parts."""
    parts = {entry.ros_name + suffix: suffix for suffix in (_SEND_GOAL, _GET_RESULT, _FEEDBACK)}
    found = [each for each in offers if each.interface.name in parts and each.role in ("service", "publisher")]
    sending = [each for each in found if each.interface.name.endswith(_SEND_GOAL)]
    types = [
        type_ for each in sending if (type_ := each.interface.type.removesuffix("_SendGoal")) != each.interface.type
    ]
    typed = entry.type or next(iter(types), "")
    if not typed:
        return None
    hashes = {each.interface.type: each.type_hash for each in found if each.type_hash}
    return Selected(replace(entry, type=typed), {part: said for part, said in hashes.items() if part.startswith(typed)})


def _matching(configuration: Configuration, offers: Iterable[Offer], namespace: str) -> Iterator[Entry]:
    """Yield an entry for each name that matches the patterns: by name, each once."""
    if not configuration.expose:
        return
    wanted, denied = _pattern(configuration.expose), _pattern((*configuration.deny, *DENIED_NAMES))
    denied_types, seen = _pattern(DENIED_TYPES), set[str]()
    for name, type_, role in sorted(_interfaces(offers)):
        if name in seen or not wanted.match(name) or denied.match(name) or denied_types.match(type_):
            continue
        seen.add(name)
        component, member = names_of(name, namespace)
        if role == "publisher":
            yield PropertyEntry(topic=name, component=component, name=member)
        elif role == "service":
            yield ActionEntry(service=name, component=component, name=member)
        else:
            yield ActionEntry(action=name, component=component, name=member)


def _interfaces(offers: Iterable[Offer]) -> Iterator[tuple[str, str, str]]:
    """Yield the name, type and role of what nodes offer, actions as one."""
    for each in offers:
        name, type_ = each.interface.name, each.interface.type
        if each.role == "service" and name.endswith(_SEND_GOAL):
            yield name.removesuffix(_SEND_GOAL), type_.removesuffix("_SendGoal"), "action"
        elif each.role in ("publisher", "service"):
            yield name, type_, each.role


def _pattern(patterns: Iterable[str]) -> re.Pattern[str]:
    return re.compile("|".join(map(translate, patterns)) or r"(?!)")
