"""Drives to a goal: what a base is asked to do, what is around it, and which of two goes first. Metre, radian."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol
from uuid import uuid4

from msgspec import Struct

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.navigation.messages import (
    FloorCells,
    Goal,
    Obstacle,
    Polygon,
    Strip,
    Way,
)


class Around(Struct, frozen=True):
    """A base and what is around it: its pose in the world, its outline, and the obstacles on the floor.

    A robot that moves is an obstacle on its way too, which ``passes``.
    """

    pose: Pose
    outline: Polygon
    obstacles: tuple[Obstacle, ...]
    cells: FloorCells | None = None
    lateral: bool = False


class Ended(Struct, frozen=True):
    """The end of a drive along a way.

    One that was ``blocked`` stands before something that has come into its way, one that was ``refused`` has not begun,
    and one that is ``lost`` is not on its way any more.
    """

    arrived: bool = False
    blocked: str = ""
    lost: str = ""
    refused: str = ""
    failed: str = ""


class DriveError(Exception):
    """A drive cannot reach its goal; the message says why."""


class NoWayError(DriveError):
    """There is no way to the goal. ``by`` are the names of what blocks it."""

    def __init__(self, message: str, by: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.by = by


class UnplannedError(DriveError):
    """No way could be planned now; there may be one."""


class Base(Protocol):
    """A base that can be driven."""

    @property
    def name(self) -> str:
        """The name of its obstacle: that of the robot."""

    def may_know(self, name: str) -> bool:
        """Return True if whoever drives it may know of a robot."""

    async def around(self) -> Around:
        """Return what is around it. Raises UnplannedError if that is unknown now, DriveError if it cannot drive any
        more, and errors of the gateway.
        """

    async def follow(self, way: Way) -> Ended:
        """Drive along a way, until the base stands."""


class Ask(Struct, frozen=True):
    """A request to the drive of a robot at another gateway: to leave a floor for the drive of the robot ``asker``.

    One that is ``passed_on`` comes from a drive that could not give way itself.
    """

    asker: str
    floor: tuple[Polygon, ...]
    passed_on: bool = False


@dataclass
class Aside:
    """A request to a drive: to leave this floor for the drive that asks, until that is on its way."""

    asker: "Trip"
    floor: tuple[Polygon, ...]
    done: bool = False

    @property
    def is_over(self) -> bool:
        return self.asker.driving or self.asker.ended


@dataclass(eq=False)
class Trip:
    """A drive to a goal. Of two, the one with the lower ``rank`` goes first."""

    base: Base
    goal: Goal
    rank: tuple[int, int]
    corridor: tuple[Strip, ...] = ()
    report: Callable[[str], None] = lambda reason: None
    way: tuple[Polygon, ...] = ()
    """The floor that it covers on the way that it drives."""
    ended: bool = False
    aside: Aside | None = None
    waits_for: tuple[str, ...] = ()
    """The robots for which it waits."""
    helpless: set["Trip"] = field(default_factory=set)
    """The drives that asked for its floor, which it could not leave."""
    asks: dict[str, Ask] = field(default_factory=dict)
    """By robot, what it asks of drives at other gateways."""
    drives_elsewhere: bool = False
    """True if it is on its way at another gateway."""
    id: str = field(default_factory=lambda: str(uuid4()))

    @property
    def name(self) -> str:
        return self.base.name

    @property
    def driving(self) -> bool:
        return bool(self.way) or self.drives_elsewhere


def known_name(trip: Trip, other: Trip) -> str:
    """Return the name of another drive's robot; nothing if whoever drives may not know it."""
    return other.name if trip.base.may_know(other.name) else ""


def goes_first(one: Trip, other: Trip) -> bool:
    """Return True if ``other`` has to give way: it comes later, and could, or it comes first and ``one`` could not."""
    first, second = sorted((one, other), key=lambda each: each.rank)
    return one is (second if first in second.helpless else first)
