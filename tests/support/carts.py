"""Bases without joints, at the origin of the world, in the live state of a gateway."""

import msgspec

from linked_fleet_agent.components.driving import planar_base
from linked_fleet_agent.planar import Pose, Velocity
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, State
from linked_fleet_gateway.extensions.world.placement import PLACEMENT
from linked_fleet_gateway.serving import Live
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.robot import Robot

_UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def cart_urdf(length_m: float, width_m: float) -> str:
    """Return the description of a box that drives."""
    box = f'<box size="{length_m} {width_m} 0.3"/>'
    shape = f'<collision><origin xyz="0 0 0.2"/><geometry>{box}</geometry></collision>'
    return f'<robot name="cart"><link name="base">{shape}</link></robot>'


def add_cart(live: Live, name: str, urdf: str) -> Robot:
    """Add a robot whose odometry frame is the world."""
    description = Description(
        version=1, robot=name, incarnation=1, title=name, urdf=urdf, joints=(), rate_hz=100, capabilities=(),
        layout=layout(0, True), base="floating",
    )  # fmt: skip
    for event in (Appeared(name, 1), Described(description)):
        live.fleet.apply(event, 1)
    robot = live.fleet.robots[name]
    pose = {"position_m": (0.0, 0.0, 0.0), "orientation_xyzw": _UPRIGHT}
    robot.settings = {PLACEMENT: msgspec.json.encode(pose).decode()}
    return robot


def frame(name: str, sequence: int, pose: Pose, velocity: Velocity, *, monotonic_ns: int) -> Framed:
    """Return a frame of a cart."""
    state = State(
        incarnation=1, sequence=sequence, monotonic_ns=monotonic_ns, wall_ns=1, positions=(), velocities=(),
        efforts=(), base=planar_base(pose, velocity),
    )  # fmt: skip
    return Framed(name, encode_state(state))
