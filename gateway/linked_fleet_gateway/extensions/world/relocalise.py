"""The action ``relocalise``: a base is said to stand somewhere, which corrects the placement of its odometry frame.

The placement of a robot with a floating base is that of its odometry frame, so a link is in the world at placement ×
base × link. Odometry drifts: the base stands elsewhere than the product says. The action turns and shifts the placement
in the plane, so that the base stands where it was said to be. Height and tilt stay.
"""

import math

from linked_fleet_gateway.api import ActionRequest, Call, Conflict, Core, Graph, Operation, Robot
from linked_fleet_gateway.extensions.world.driving import heading_of
from linked_fleet_gateway.extensions.world.placement import (
    LF,
    PLACEMENT,
    accepts_unchecked,
    describe_placement,
    encode_placement,
    number_of,
    placement_of,
)
from linked_fleet_gateway.extensions.world.scene import FARTHEST_M
from linked_fleet_rdf.vocabulary import MATHS
from linked_fleet_state.kinematics import ORIGIN, compose
from linked_fleet_state.model import Pose


def flat_pose(x: float, y: float, heading: float) -> Pose:
    """Return an upright pose on the floor."""
    return Pose((x, y, 0.0), (0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)))


def corrected(placement: Pose, base: Pose, x: float, y: float, heading: float) -> Pose | None:
    """Return the placement, turned about z and shifted in the plane, at which a base stands at ``x``, ``y``.

    ``base`` is the pose of the base in the placed frame. None if the base has no heading. Metre, radian.
    """
    stands = compose(placement, base)
    looks = heading_of(stands)
    if looks is None:
        return None
    turned = flat_pose(0.0, 0.0, math.remainder(heading - looks, math.tau))
    stood = compose(turned, stands).position_m
    shifted = Pose((x - stood[0], y - stood[1], 0.0), turned.orientation_xyzw)
    return compose(shifted, placement)


class Relocalise:
    """Plans the action."""

    def __init__(self, core: Core) -> None:
        self._core = core

    def plan(self, request: ActionRequest) -> Operation:
        robot, body = request.required_robot(), request.body
        place, looks = body.node(body.root, LF.position), body.node(body.root, LF.heading)
        assert place is not None and looks is not None
        scale = body.unit(place)
        x, y = number_of(body, place, MATHS.x) * scale, number_of(body, place, MATHS.y) * scale
        heading = body.quantity(looks)
        if max(abs(x), abs(y)) > FARTHEST_M:
            raise Conflict(f"Robots stand within {FARTHEST_M:g} m of the origin of the world.")
        corrected_placement(robot, x, y, heading)  # a rehearsal says what prevents it too

        async def run(call: Call) -> None:
            while not await self._core.set_setting(robot, PLACEMENT, corrected_placement(robot, x, y, heading)):
                pass  # another gateway has changed the placement, which is known now
            call.accept()
            graph = Graph()
            root = graph.blank(LF.Placement)
            describe_placement(graph, root, robot)
            call.set_output(graph.triples, root)

        return Operation(run)


def corrected_placement(robot: Robot, x: float, y: float, heading: float) -> str:
    """Return the record of the corrected placement of the odometry frame. Raises Conflict."""
    base = None if robot.model is None else robot.link_pose(robot.model.root)
    if base is None:
        raise Conflict(f"The base of {robot.name} has no known pose in its odometry frame, so the frame has no place.")
    found = corrected(placement_of(robot) or ORIGIN, base, x, y, heading)
    if found is None:
        raise Conflict(f"The base of {robot.name} lies with its x axis upright, so that it has no heading.")
    return encode_placement(found, accepts_unchecked(robot))
