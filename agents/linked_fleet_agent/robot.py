"""The interface of drivers. Angles in radian, lengths in metre, efforts in newton metre or newton."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

from linked_fleet_agent.wire.messages import Base, Camera, PictureFormat


class PictureError(Exception):
    """A picture that cannot be had; the message says why."""


class RobotFaultError(Exception):
    """The robot cannot be read or driven now; the agent reports it and holds until a read succeeds again."""


@dataclass(frozen=True)
class Limits:
    """Limits of one joint in rad, rad/s, N·m (revolute) or m, m/s, N (prismatic); None is unbounded or unknown."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None

    def clamp(self, position: float) -> float:
        """The position nearest to ``position`` that the limits allow."""
        if self.lower is not None:
            position = max(position, self.lower)
        return position if self.upper is None else min(position, self.upper)


@dataclass(frozen=True)
class JointFacts:
    """One movable joint of one degree of freedom; ``mimics`` names the joint that it follows, if any.

    A ``continuous`` joint turns endlessly: positions a whole turn apart are the same place. A ``passive`` one is
    measured, but nothing drives it that could be told to.
    """

    name: str
    linear: bool = False
    limits: Limits = Limits()
    mimics: str | None = None
    continuous: bool = False
    passive: bool = False


@dataclass(frozen=True)
class Facts:
    """Facts about a robot that are known without touching it; ``joints`` is the order of every array in a Reading.

    ``meshes``: files of the meshes that the URDF names, by their URI there; a driver may have none (meshes.py).
    ``cameras``: of a driver that is ``Seeing``; each has another name.
    """

    title: str
    urdf: str
    joints: tuple[JointFacts, ...]
    floating: bool = False
    annotations: str = ""
    meshes: Mapping[str, Path] = field(default_factory=dict)
    cameras: tuple[Camera, ...] = ()


@dataclass(frozen=True)
class Reading:
    """Measured values in the order of ``Facts.joints``; NaN is unknown. ``base`` is set exactly on floating bases."""

    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]
    base: Base | None = None


class Robot(Protocol):
    """A driver. All methods are called from one thread and should return within a millisecond or so."""

    def describe(self) -> Facts:
        """The facts; works while the robot is offline and never changes."""

    def read(self, now_s: float) -> Reading:
        """Measure. A simulation first advances itself to ``now_s`` (monotonic seconds), hardware ignores it.

        Raises RobotFaultError (or whatever the hardware library raises) when nothing can be measured.
        """

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        """Take new position setpoints, leave all others; return what was really applied, after the driver's limits."""

    def stop(self) -> None:
        """Hold where the robot is now. Always safe, at any time and any number of times."""

    def close(self) -> None:
        """Release everything; the object is not used afterwards."""


@runtime_checkable
class Seeing(Protocol):
    """A driver whose robot has cameras."""

    def picture(self, camera: Camera, format: PictureFormat, reading: Reading) -> bytes:
        """Return the picture of the robot as in ``reading``: a JPEG or PNG file of the camera's size, or its depths.

        Called in a thread beside the others, one call after another; it may take its time. Depths are little-endian
        float32 in metre along the axis, row by row, NaN where nothing is in range. Raises PictureError.
        """
