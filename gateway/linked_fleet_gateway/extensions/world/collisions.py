"""Motions refused because of a collision: the latest of each robot, until one of its motions is found free.

Each gateway knows those that it has refused itself, including rehearsals, and forgets them when it ends. Errors of the
check: ``Collides`` (409, collision), ``UncheckedLinks`` (409, unchecked-links), ``Unchecked`` (503, unchecked).
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from pyoxigraph import Literal, NamedNode

from linked_fleet_base.errors import Members, MotionRefused
from linked_fleet_gateway.api import RequestView, Resource, Source, blueprint_of, robot_of, robot_path
from linked_fleet_gateway.extensions.world.placement import LF, WORLD
from linked_fleet_rdf.graph import METRE, Graph, timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, RDFS
from linked_fleet_state.unchecked import UncheckedLink
from linked_fleet_state.xml import Vector


class Collides(MotionRefused):
    """The motion would collide.

    ``things`` are IRIs of the robot's link and of the other body, if the caller may know it, with ``names`` for people.
    ``share`` is the free share of the path, ``point`` the place of the collision in the world in metre, if known.
    ``reason`` names only parts of the robot itself.
    """

    status, code, title = 409, "collision", "The motion would end in a collision"

    def __init__(
        self,
        detail: str,
        *,
        things: Sequence[str] = (),
        names: Sequence[str] = (),
        share: float | None = None,
        point: Vector | None = None,
        reason: str = "",
    ) -> None:
        super().__init__(detail, reason=reason)
        self.things, self.names, self.share, self.point = list(things), list(names), share, point
        self.add: Mapping[str, str] = {}
        """Members that the same body may have in addition, so that it is not refused for this reason."""
        self.after_s: float | None = None
        """The time until the way will be free, if others that move keep their times."""

    def advise(self, sentence: str, add: Mapping[str, str]) -> None:
        """Say what the same request may have in addition."""
        self.detail, self.add = f"{self.detail} {sentence}", add

    def promise(self, after_s: float) -> None:
        """Say when the way will be free."""
        self.after_s, whole_s = after_s, math.ceil(after_s)
        self.headers["Retry-After"] = str(whole_s)
        self.detail = f"{self.detail} The way will be free in {whole_s} s, once robots that move have arrived."

    def locate(self, base: str) -> None:
        self.things = [base + path for path in self.things]

    @property
    def members(self) -> Members:
        if self.share is None:
            return {}
        place = {} if self.point is None else {"point": list(self.point)}
        retry: Members = {"retryWith": [dict(self.add)]} if self.add else {}
        if self.after_s is not None:
            retry["retryAfter"] = math.ceil(self.after_s)
        return {"things": self.things, "names": self.names, "share": self.share, **place, **retry}


class Unchecked(MotionRefused):
    """The motion could not be checked for collisions, so it is refused; ``reason`` as in Collides."""

    status, code, title = 503, "unchecked", "The motion could not be checked"
    retry_after_s = 2

    def __init__(self, detail: str, *, reason: str = "") -> None:
        super().__init__(detail, reason=reason or "it could not be checked for collisions")


class UncheckedLinks(MotionRefused):
    """Links that the check does not cover may meet something; ``unchecked`` are the links, each after its path."""

    status, code, title = 409, "unchecked-links", "Parts that no check covers might collide"

    def __init__(self, detail: str, *, unchecked: Sequence[tuple[str, UncheckedLink]] = (), reason: str = "") -> None:
        super().__init__(detail, reason=reason)
        self.unchecked = list(unchecked)

    def locate(self, base: str) -> None:
        self.unchecked = [(base + path, each) for path, each in self.unchecked]

    @property
    def members(self) -> Members:
        links = [{"link": path, "mesh": each.mesh, "reason": each.reason} for path, each in self.unchecked]
        return {"unchecked": links} if links else {}


COLLISIONS = f"{WORLD}/collisions"


@dataclass(frozen=True)
class Collision:
    """A collision. ``things`` are the paths of both things, ``names`` their titles, ``point`` a place in the world (m).

    ``detail`` names both things, ``reason`` only what belongs to the robot.
    """

    robot: str
    things: tuple[str, ...]
    names: tuple[str, ...]
    point: Vector | None
    detail: str
    reason: str
    at_ns: int

    def is_visible(self, view: RequestView) -> bool:
        """Return True if the caller sees every robot involved."""
        return all(name is None or name in view.robots for name in map(_robot_of, self.things))


def _robot_of(path: str) -> str | None:
    return None if path.startswith(f"{WORLD}/") else robot_of(path)


Known = Mapping[str, Collision]
"""Collisions by the name of the robot that would have moved."""
NONE: Known = MappingProxyType({})


class Collisions:
    """The collisions of refused motions. ``touched`` is called with the path of each changed resource."""

    def __init__(self, touched: Callable[[str], None]) -> None:
        self.known: dict[str, Collision] = {}
        self._touched = touched

    def add(self, robot: str, error: Collides) -> None:
        """Store why a motion was refused; the paths in ``error`` are not IRIs yet."""
        things, names = tuple(error.things), tuple(error.names)
        point = error.point
        self.known[robot] = Collision(robot, things, names, point, str(error.detail), error.reason, time.time_ns())
        self._touched(COLLISIONS)

    def forget(self, robot: str) -> None:
        """Remove the entry of a robot after one of its motions was found free."""
        if self.known.pop(robot, None) is not None:
            self._touched(COLLISIONS)


def resolve_collisions(view: RequestView, rest: list[str], known: Known) -> Resource | None:
    """Return the resource at ``rest``, the segments below ``/world/collisions``."""
    whole = Resource(
        COLLISIONS,
        "Refused motions",
        lambda graph: _describe(graph, view, known),
        source=Source(lambda: [each for each in known.values() if each.robot in view.robots]),
        own_paths=(f"{COLLISIONS}/blueprint",),
    )
    if rest == ["blueprint"]:
        return blueprint_of(whole, view.base, (LF.CollisionsShape,))
    return None if rest else whole


def _describe(graph: Graph, view: RequestView, known: Known) -> None:
    iri = view.iri(COLLISIONS)
    graph.a(iri, LF.Collisions)
    graph.add(iri, DCTERMS.title, Literal("Refused motions"))
    graph.add(iri, RDFS.seeAlso, view.iri(WORLD))
    graph.add(iri, HYBRIT.blueprint, LF.CollisionsShape, NamedNode(iri.value + "/blueprint"))
    for each in sorted(known.values(), key=lambda each: -each.at_ns):
        if each.robot in view.robots:
            _describe_one(graph, view, iri, each)


def _describe_one(graph: Graph, view: RequestView, iri: NamedNode, collision: Collision) -> None:
    """Describe a collision. The place and the other thing are left out if the caller may not see them."""
    node = graph.blank(LF.Collision)
    graph.add(iri, LF.collision, node)
    graph.add(node, LF.ofRobot, view.iri(robot_path(collision.robot)))
    graph.add(node, DCTERMS.created, timestamp(collision.at_ns))
    seen = collision.is_visible(view)
    graph.add(node, LF.reason, Literal(collision.detail if seen else collision.reason))
    if not seen:
        return
    if collision.point is not None:
        graph.vector(node, LF.position, collision.point, METRE)
    for path, name in zip(collision.things, collision.names, strict=True):
        thing = view.iri(path)
        graph.add(node, LF.meets, thing)
        graph.add(thing, RDFS.label, Literal(name))
