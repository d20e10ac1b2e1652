"""Events of the fleet: created by the link, consumed by ``Fleet.apply``."""

from dataclasses import dataclass

from linked_fleet_agent.wire import messages


@dataclass(frozen=True)
class Appeared:
    """The presence token of one run of an agent has appeared."""

    robot: str
    incarnation: int


@dataclass(frozen=True)
class Vanished:
    """The presence token of one run of an agent has gone."""

    robot: str
    incarnation: int


@dataclass(frozen=True)
class Described:
    """An agent has sent the description of its robot."""

    description: messages.Description


@dataclass(frozen=True)
class Undescribed:
    """An agent is present, but its description is unusable."""

    robot: str
    incarnation: int
    reason: str


@dataclass(frozen=True)
class Framed:
    """A state frame has arrived; it is not yet decoded."""

    robot: str
    payload: bytes


@dataclass(frozen=True)
class Moved:
    """Newer frames of a watched robot are in ``frames.Frames``."""

    robot: str


Event = Appeared | Vanished | Described | Undescribed | Framed | Moved
