"""Parts of simulated robots beside their joints, as data."""

from dataclasses import dataclass


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


@dataclass(frozen=True)
class Parts:
    """The parts of one robot."""

    fingers: tuple[FingersPart, ...] = ()
    battery: BatteryPart | None = None
    tool: ToolPart | None = None


NO_PARTS = Parts()
