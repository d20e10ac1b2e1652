"""The motion that a request to a component makes."""

import math
from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from linked_fleet_agent.planar import DriveLimits, Pose, Velocity
from linked_fleet_gateway.api import ActionRequest, Motion
from linked_fleet_gateway.extensions.components.offers import ComponentOffer, InputBody
from linked_fleet_gateway.extensions.components.part import ComponentPart
from linked_fleet_gateway.extensions.components.terms import LF
from linked_fleet_gateway.fleet.driving import Drive, FollowedPath
from linked_fleet_gateway.serving import Act

_BASE = LF.extended("Base").Base.value


def plan(offer: ComponentOffer, request: ActionRequest) -> Motion:
    value = request.body.value if isinstance(request.body, InputBody) else {}
    declared = offer.declared
    act = Act(
        offer.part.name,
        msgspec.json.encode(value),
        offer.of_action,
        offer.of_property,
        () if declared is None else declared.moves,
        drive=drive_of(offer.part, offer.of_action, value),
        path=_path_of(offer.part, offer.of_action, value),
    )
    return Motion(request.required_robot(), act, {}, request.required_time())


def _path_of(part: ComponentPart, action: str, given: Mapping[str, Any]) -> FollowedPath | None:
    """Return the path that a base follows; None for another action."""
    if action != "followPath" or part.declared.semantic_type != _BASE:
        return None
    most = part.state.value("driveLimits") or {}
    poses = tuple(Pose(each["x"], each["y"], _number(each.get("heading"))) for each in given["path"])
    return FollowedPath(poses, bool(given.get("reverse")), bool(most.get("lateral")))


def _number(given: float | None) -> float:
    return math.nan if given is None else given


def stream(offer: ComponentOffer, request: ActionRequest) -> Motion:
    """Return the motion that opens an action as a stream. It ends with the control lease, if somebody has that."""
    robot, motion = request.required_robot(), plan(offer, request)
    assert isinstance(motion.motion, Act)
    return replace(motion, motion=replace(motion.motion, stream=True), tied_to_lease=robot.lease is not None)


def drive_of(part: ComponentPart, action: str, given: Mapping[str, Any]) -> Drive | None:
    """Return what a base does with an input of its action drive.

    None for another action, and if the base does not say how it brakes.
    """
    is_drive = action == "drive" and part.declared.semantic_type == _BASE
    most = part.state.value("driveLimits") if is_drive else None
    declared = part.declared.actions[action].input if is_drive else None
    if most is None or declared is None:
        return None
    defaults = {name: each.default for name, each in declared.properties.items()}
    said = {name: given[name] if name in given else defaults.get(name) for name in (*Velocity._fields, "duration")}
    velocity = Velocity(*(float(said[name] or 0.0) for name in Velocity._fields))
    try:
        limits = DriveLimits(
            most["linear"], most["angular"], most["linearAcceleration"], most["angularAcceleration"], most["lateral"]
        )
    except ValueError:
        return None
    return Drive(velocity, float(said["duration"] or 0.0), limits)
