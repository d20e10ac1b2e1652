"""The place where a robot comes closest to what is around it. Pure values."""

from msgspec import Struct

from linked_fleet_state.xml import Vector


class Closest(Struct, frozen=True):
    """The place where a robot comes closest to something on a path.

    Elsewhere it may come nearer than ``apart_m`` by ``uncertain_m``. ``things`` are the paths of the robot's link and
    of the other thing, if the caller may know it, with ``names`` for people; ``point`` is a place in the world in metre
    between them. ``share`` is the completed share of the path there, ``at_s`` the time, if it is known.
    """

    apart_m: float
    uncertain_m: float
    share: float
    things: tuple[str, ...]
    names: tuple[str, ...]
    at_s: float | None = None
    point: Vector | None = None
