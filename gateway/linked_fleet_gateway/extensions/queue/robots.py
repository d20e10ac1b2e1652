"""Which robots an order can have now, and why not the others.

All of one pass over the queue: what is asked for many orders is looked up once for each robot.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from linked_fleet_gateway.api import Pose, Robot
from linked_fleet_gateway.extensions.availability.availability import out_of_service
from linked_fleet_gateway.extensions.latches.extension import Latches
from linked_fleet_gateway.extensions.queue.order import Choice, Point
from linked_fleet_gateway.faces import offers_at, parts_of
from linked_fleet_state.kinematics import compose

Placement = Callable[[Robot], Pose | None]


@dataclass(frozen=True)
class Standing:
    """The ability of a robot to have an order: ``reason`` says why it cannot, empty if it can.

    A robot that is only ``busy`` is kept for the first order that waits for it; one that is not there is not.
    """

    reason: str = ""
    busy: bool = False


FREE = Standing()


class Abilities:
    """The parts and actions of robots, kept until they describe themselves anew."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[object, object, frozenset[str]]] = {}

    def of(self, robot: Robot) -> frozenset[str]:
        """Return the classes of its components and the kinds of its actions, as IRIs."""
        held = self._known.get(robot.name)
        if held is None or held[0] is not robot.description or held[1] is not robot.parts:
            held = self._known[robot.name] = robot.description, robot.parts, _abilities(robot)
        return held[2]


def _abilities(robot: Robot) -> frozenset[str]:
    joints = () if robot.model is None else robot.model.joints.values()
    offers = [*offers_at(robot), *(offer for each in joints for offer in offers_at(robot, each))]
    offers += [offer for part in parts_of(robot).values() for offer in part.offers.values()]
    classes = (each.value for part in parts_of(robot).values() for each in part.types)
    return frozenset((*classes, *(each.definition.iri.value for each in offers)))


@dataclass
class Robots:
    """The robots of the fleet during one pass; ``taken`` says by robot which order has it."""

    known: Mapping[str, Robot]
    moving: Collection[str]
    """Robots with an action of a client that has not ended."""
    taken: dict[str, str]
    abilities: Abilities
    placements: Sequence[Placement] = ()
    latches: Latches | None = None
    """Stops that hold, with the extension ``latches``."""
    reserved: set[str] = field(default_factory=set)
    """Robots that are kept for an order that comes before."""
    _standing: dict[str, Standing] = field(default_factory=dict)
    _able: dict[str, frozenset[str]] = field(default_factory=dict)
    _places: dict[str, tuple[float, float] | None] = field(default_factory=dict)

    def take(self, robots: Collection[str], order: str) -> None:
        """Give robots to an order."""
        self.taken |= dict.fromkeys(robots, order)

    def standing(self, name: str, battery: float) -> Standing:
        """Return whether an order that needs so much charge, in percent, can have a robot now."""
        if name in self.taken:
            return Standing("has another order", busy=True)
        found = self._standing.get(name)
        if found is None:
            found = self._standing[name] = self._present(name)
        if found.reason:
            return found
        if battery and (low := self._lacks(name, battery)):
            return Standing(low)
        return Standing("is kept for an order before this one", busy=True) if name in self.reserved else FREE

    def _present(self, name: str) -> Standing:
        robot = self.known.get(name)
        if robot is None:
            return Standing("is not known")
        if (reason := out_of_service(robot)) is not None:
            return Standing(f"is out of service: {reason}")
        if self.latches is not None and self.latches.of(name) is not None:
            return Standing("is stopped, and the stop holds until it is reset")
        if not robot.online:
            return Standing("is offline")
        if robot.lease is not None:
            return Standing(f"is controlled by {robot.lease.holder}", busy=True)
        return Standing("carries out what a client has asked for", busy=True) if name in self.moving else FREE

    def _lacks(self, name: str, battery: float) -> str:
        """Return why a robot has too little charge; empty if it has enough, or no battery."""
        has_battery = _BATTERY in self.abilities.of(self.known[name])
        charges = [each.battery_percent for each in parts_of(self.known[name]).values()]
        known = [each for each in charges if each is not None]
        if not has_battery:
            return ""
        if not known:
            return "does not say how much charge its battery has"
        return "" if min(known) >= battery else f"has {min(known):.0f} % of charge, and needs {battery:g} %"

    # -- any robot that can -----------------------------------------------------------------------------------------

    def able(self, choice: Choice, selected: Collection[str] | None, path_of: Callable[[str], str]) -> list[str]:
        """Return the robots that a choice allows, the nearest first. ``selected`` are those of its query, if any.

        ``path_of`` returns the robot that an IRI names, or an empty text.
        """
        sets: list[Collection[str]] = [frozenset(map(path_of, choice.robots))] if choice.robots else []
        sets += [self._with(each) for each in (choice.kind, choice.offers) if each]
        sets += [selected] if selected is not None else []
        found = [each for each in sets[0] if each and all(each in other for other in sets[1:])] if sets else []
        near = choice.near
        if near is None:
            return sorted(found)
        return sorted(found, key=lambda name: (self._distance(name, near), name))

    def _with(self, ability: str) -> frozenset[str]:
        if ability not in self._able:
            found = (name for name, robot in self.known.items() if ability in self.abilities.of(robot))
            self._able[ability] = frozenset(found)
        return self._able[ability]

    def _distance(self, name: str, near: Point) -> float:
        """Return how far a robot is from a point of the floor; infinite if its place is not known."""
        if name not in self._places:
            self._places[name] = self._place(name)
        place = self._places[name]
        return math.inf if place is None else math.hypot(place[0] - near.x, place[1] - near.y)

    def _place(self, name: str) -> tuple[float, float] | None:
        robot = self.known.get(name)
        if robot is None or robot.model is None:
            return None
        frame = next((found for each in self.placements if (found := each(robot)) is not None), None)
        base = robot.link_pose(robot.model.root)
        if frame is None or base is None:
            return None
        x, y, _ = compose(frame, base).position_m
        return x, y


_BATTERY = "https://w3id.org/linked-fleet#Battery"
