"""Grippers, as their robots describe them. Pure."""

from msgspec import Struct


class Gripper(Struct, frozen=True):
    """A gripper that moves ``joints``, mounted on a ``link``, which is empty if the robot does not say it.

    ``holding`` says if it holds something, None if that is unknown, and is so since ``holding_ns``. It has lost what it
    held at ``lost_ns``, 0 for never. Times are wall times of the agent.
    """

    joints: tuple[str, ...]
    link: str = ""
    holding: bool | None = None
    holding_ns: int = 0
    lost_ns: int = 0
