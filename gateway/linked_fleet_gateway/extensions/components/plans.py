"""The motion that a request to a component makes."""

import msgspec
from msgspec.structs import replace

from linked_fleet_gateway.api import ActionRequest, Motion
from linked_fleet_gateway.extensions.components.offers import ComponentOffer, InputBody
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
    )
    return Motion(request.required_robot(), act, {}, request.required_time())


def stream(offer: ComponentOffer, request: ActionRequest) -> Motion:
    """Return the motion that opens an action as a stream. It ends with the control lease, if somebody has that."""
    robot, motion = request.required_robot(), plan(offer, request)
    assert isinstance(motion.motion, Act)
    return replace(motion, motion=replace(motion.motion, stream=True), tied_to_lease=robot.lease is not None)
