"""Events of the fleet: made by the link, consumed by ``Fleet.apply``."""

from dataclasses import dataclass

from linked_fleet_agent.wire import messages


@dataclass(frozen=True)
class Appeared:
    """The presence token of one run of an agent was seen."""

    robot: str
    incarnation: int


@dataclass(frozen=True)
class Vanished:
    """The presence token of one run of an agent is gone."""

    robot: str
    incarnation: int


@dataclass(frozen=True)
class Described:
    """An agent said what its robot is."""

    description: messages.Description


@dataclass(frozen=True)
class Undescribed:
    """An agent is present, but what it says of its robot cannot be used."""

    robot: str
    incarnation: int
    reason: str


@dataclass(frozen=True)
class Framed:
    """A state frame came; nothing of it has been looked at."""

    robot: str
    payload: bytes


@dataclass(frozen=True)
class Moved:
    """Newer frames of a robot that somebody watches lie ready (``frames.Frames``)."""

    robot: str


Event = Appeared | Vanished | Described | Undescribed | Framed | Moved
