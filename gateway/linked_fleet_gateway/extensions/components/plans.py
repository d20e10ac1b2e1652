"""The motion that a request to a component makes."""

from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from linked_fleet_agent.planar import Velocity
from linked_fleet_gateway.api import ActionRequest, Motion
from linked_fleet_gateway.extensions.components.bases import drive_limits, is_base, way_of
from linked_fleet_gateway.extensions.components.offers import ComponentOffer, InputBody
from linked_fleet_gateway.extensions.components.part import ComponentPart
from linked_fleet_gateway.fleet.driving import Drive
from linked_fleet_gateway.serving import Act


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
        path=way_of(offer.part.state, offer.of_action, value),
    )
    return Motion(request.required_robot(), act, {}, request.required_time())


def stream(offer: ComponentOffer, request: ActionRequest) -> Motion:
    """Return the motion that opens an action as a stream. It ends with the control lease, if somebody has that."""
    robot, motion = request.required_robot(), plan(offer, request)
    assert isinstance(motion.motion, Act)
    return replace(motion, motion=replace(motion.motion, stream=True), tied_to_lease=robot.lease is not None)


def drive_of(part: ComponentPart, action: str, given: Mapping[str, Any]) -> Drive | None:
    """Return what a base does with an input of its action drive.

    None for another action, and if the base does not say how it brakes.
    """
    is_drive = action == "drive" and is_base(part.declared)
    limits = drive_limits(part.state) if is_drive else None
    declared = part.declared.actions[action].input if is_drive else None
    if limits is None or declared is None:
        return None
    defaults = {name: each.default for name, each in declared.properties.items()}
    said = {name: given[name] if name in given else defaults.get(name) for name in (*Velocity._fields, "duration")}
    velocity = Velocity(*(float(said[name] or 0.0) for name in Velocity._fields))
    return Drive(velocity, float(said["duration"] or 0.0), limits)
