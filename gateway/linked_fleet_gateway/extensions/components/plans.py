"""The motion that a request to a component makes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec.structs import replace

from linked_fleet_agent.planar import Velocity
from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.api import ActionRequest, Conflict, DeferredPlan, Motion
from linked_fleet_gateway.extensions.components.bases import drive_limits, is_base, way_of
from linked_fleet_gateway.extensions.components.component import DeclaredComponent
from linked_fleet_gateway.extensions.components.hand_declaration import JOG_HAND, JOG_JOINTS, JOGGING
from linked_fleet_gateway.extensions.components.offers import ComponentOffer, InputBody
from linked_fleet_gateway.extensions.components.things import without_things
from linked_fleet_gateway.serving import Act
from linked_fleet_state.driving import Drive
from linked_fleet_state.jogging import JointDrive

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.components import hand_jogging
else:
    # It loads Pinocchio, which takes 60 MB.
    hand_jogging = LazyModule("linked_fleet_gateway.extensions.components.hand_jogging")


def plan(offer: ComponentOffer, request: ActionRequest) -> Motion | DeferredPlan:
    value = request.body.value if isinstance(request.body, InputBody) else {}
    request.required_time()
    if is_hand(offer):
        return DeferredPlan(lambda: _of_hand(offer, request, value))
    return _motion(offer, offer.of_action, request, value)


def is_hand(offer: ComponentOffer) -> bool:
    """Return True for the action that the gateway has added, and that joints carry out."""
    return offer.of_action == JOG_HAND and offer.part.declared.semantic_type == JOGGING


def _of_hand(offer: ComponentOffer, request: ActionRequest, value: Mapping[str, Any]) -> Motion:
    try:
        found = hand_jogging.jogged(offer.part, value)
    except hand_jogging.CannotJogError as error:
        raise Conflict(f"The hand cannot be jogged: {error}.") from error
    facts = {} if found.share >= 1.0 else {"speedShare": found.share}
    return replace(_motion(offer, JOG_JOINTS, request, found.input), facts=facts)


def prepare_hand(offer: ComponentOffer) -> None:
    """Load what jogs a hand. Call it in a thread. Raises Conflict."""
    try:
        hand_jogging.prepare(offer.part)
    except hand_jogging.CannotJogError as error:
        raise Conflict(f"The hand cannot be jogged: {error}.") from error


def as_joints(offer: ComponentOffer, given: msgspec.Raw) -> tuple[msgspec.Raw, float, str]:
    """Return the input that the robot gets for a sample, the share of the asked speed that it has, and why."""
    if not is_hand(offer):
        return given, 1.0, ""
    try:
        found = hand_jogging.jogged(offer.part, msgspec.json.decode(given))
    except hand_jogging.CannotJogError as error:
        return msgspec.Raw(b'{"velocities":{}}'), 0.0, str(error)
    return msgspec.Raw(msgspec.json.encode(found.input)), found.share, found.limited


def _motion(offer: ComponentOffer, action: str, request: ActionRequest, value: Mapping[str, Any]) -> Motion:
    declared = offer.declared
    act = Act(
        offer.part.name,
        msgspec.json.encode(without_things(declared, value)),
        action,
        offer.of_property,
        () if declared is None else declared.moves,
        declared is not None and declared.resumes,
        drive=drive_of(offer.part, action, value),
        path=way_of(offer.part.state, action, value),
    )
    return Motion(request.required_robot(), act, {}, request.required_time(), request=request)


def stream(offer: ComponentOffer, request: ActionRequest) -> Motion:
    """Return the motion that opens an action as a stream. It ends with the control lease, if somebody has that."""
    action = JOG_JOINTS if is_hand(offer) else offer.of_action
    robot, motion = request.required_robot(), _motion(offer, action, request, {})
    assert isinstance(motion.motion, Act)
    return replace(motion, motion=replace(motion.motion, stream=True), tied_to_lease=robot.lease is not None)


def drive_of(
    part: DeclaredComponent, action: str, given: Mapping[str, Any], holds_s: float | None = None
) -> Drive | JointDrive | None:
    """Return what a base or joints do with an input of drive or jogJoints, for ``holds_s`` or as long as it says.

    None for another action, and if the component does not say how it brakes.
    """
    if part.declared.semantic_type == JOGGING:
        return _joint_drive(part, action, given, holds_s)
    return _base_drive(part, action, given, holds_s)


def _joint_drive(
    part: DeclaredComponent, action: str, given: Mapping[str, Any], holds_s: float | None
) -> JointDrive | None:
    declared, accelerations = part.declared.actions.get(action), part.state.value("accelerations")
    if action != JOG_JOINTS or accelerations is None or declared is None or declared.input is None:
        return None
    if not all(each > 0.0 for each in accelerations.values()):
        return None
    usual_s = declared.input.properties["duration"].default
    duration_s = holds_s if holds_s is not None else given.get("duration", usual_s)
    velocities = {name: each for name, each in given.get("velocities", {}).items() if name in accelerations}
    return JointDrive(velocities, float(duration_s or 0.0), dict(accelerations))


def _base_drive(part: DeclaredComponent, action: str, given: Mapping[str, Any], holds_s: float | None) -> Drive | None:
    is_drive = action == "drive" and is_base(part.declared)
    limits = drive_limits(part.state) if is_drive else None
    declared = part.declared.actions[action].input if is_drive else None
    if limits is None or declared is None:
        return None
    defaults = {name: each.default for name, each in declared.properties.items()}
    said = {name: given[name] if name in given else defaults.get(name) for name in (*Velocity._fields, "duration")}
    velocity = Velocity(*(float(said[name] or 0.0) for name in Velocity._fields))
    return Drive(velocity, float(said["duration"] or 0.0) if holds_s is None else holds_s, limits)
