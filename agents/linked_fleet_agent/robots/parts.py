"""Parts of simulated robots beside their joints, as data."""

import math
from dataclasses import dataclass

from linked_fleet_agent.components.kinds import Station
from linked_fleet_agent.planar import Differential, DriveLimits
from linked_fleet_agent.robots.trot import Leg


@dataclass(frozen=True)
class FingersPart:
    """Two fingers of a gripper. The first joint has the motor, the second mimics it, and the fingers meet at zero."""

    name: str
    title: str
    link: str
    joints: tuple[str, str]


@dataclass(frozen=True)
class BatteryPart:
    """A battery with what the robot takes at rest, and what its charger gives."""

    capacity_wh: float
    idle_w: float
    charger_w: float
    link: str = ""


@dataclass(frozen=True)
class ToolPart:
    """A digital output and input at the tool."""

    title: str
    link: str


def corners_of(radius: float, count: int = 12) -> tuple[tuple[float, float], ...]:
    """Return the corners of a polygon around a round footprint (m), counterclockwise."""
    half = math.pi / count
    at = [half * (2 * index + 1) for index in range(count)]
    return tuple((radius / math.cos(half) * math.cos(each), radius / math.cos(half) * math.sin(each)) for each in at)


@dataclass(frozen=True)
class BasePart:
    """A base that rolls over the floor: its limits, its corners (m), and its left and right wheel with their drive.

    ``link`` is the root link of the robot, with its origin on the floor. Rolling takes ``resistance_n``. ``stations``
    are where the base charges, in the frame where the simulation begins.
    """

    title: str
    link: str
    limits: DriveLimits
    corners: tuple[tuple[float, float], ...]
    drive: Differential | None = None
    wheels: tuple[str, ...] = ()
    resistance_n: float = 0.0
    stations: tuple[Station, ...] = ()


@dataclass(frozen=True)
class LegsPart:
    """Four legs that walk: limits of the base, its corners (m), and the legs with their joints."""

    title: str
    link: str
    limits: DriveLimits
    corners: tuple[tuple[float, float], ...]
    legs: tuple[Leg, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints of all legs: hip, thigh and calf of the first one, and so on."""
        return tuple(f"{leg.name}_{part}_joint" for leg in self.legs for part in ("hip", "thigh", "calf"))


@dataclass(frozen=True)
class Parts:
    """The parts of one robot."""

    base: BasePart | None = None
    legs: LegsPart | None = None
    fingers: tuple[FingersPart, ...] = ()
    battery: BatteryPart | None = None
    tool: ToolPart | None = None


NO_PARTS = Parts()
