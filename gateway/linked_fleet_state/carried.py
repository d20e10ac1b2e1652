"""The pose of what a link of a robot carries. Pure."""

from msgspec import Struct

from linked_fleet_state.model import Pose


class CarriedPose(Struct, frozen=True):
    """A pose in the frame of a link of a robot, which carries it."""

    robot: str
    link: str
    pose: Pose
