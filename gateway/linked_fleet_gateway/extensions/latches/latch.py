"""The record of a stop latch, and its statements."""

from collections.abc import Mapping

from msgspec import Struct

from linked_fleet_gateway.api import (
    DCTERMS,
    Body,
    Graph,
    Literal,
    Member,
    Robot,
    UnprocessableContent,
    robot_of,
    robot_path,
    timestamp,
)
from linked_fleet_gateway.extensions.latches.terms import LF

FLEET = ""
"""In the place of a robot: all of them."""


class Latch(Struct, frozen=True, omit_defaults=True):
    """A stop of ``robot``, or of the fleet, that holds. ``by`` is the name of who has latched it."""

    robot: str
    reason: str = ""
    by: str = ""
    since_ns: int = 0
    base: str = ""
    """The root in the body, until it is compared with that of the gateway."""

    @property
    def title(self) -> str:
        return f"Stop of {self.robot or 'all robots'}"

    @property
    def path(self) -> str:
        return robot_path(self.robot) if self.robot else "/"


def read_latch(robots: Mapping[str, Robot], body: Body) -> Latch:
    """Return what a body says. Raises UnprocessableContent."""
    base, path = body.address(body.root, LF.latchAbout)
    name = FLEET if path == "/" else robot_of(path)
    if name is None or (path != "/" and (name not in robots or path != robot_path(name))):
        raise nothing_there(base + path)
    return Latch(name, (body.text(body.root, LF.reason) or "").strip(), base=base)


def nothing_there(iri: str) -> UnprocessableContent:
    """Return the error for what is neither the fleet nor a robot, and for a robot that is hidden."""
    return UnprocessableContent(
        f"about is the address of a robot or, for all of them, of the fleet, not {iri[:200]!r}."
    )


def describe_latch(graph: Graph, member: Member[Latch]) -> None:
    iri, latch = member.iri, member.record
    graph.add(iri, LF.latchAbout, member.view.iri(latch.path))
    graph.add(iri, LF.latchedBy, Literal(latch.by))
    if latch.since_ns:
        graph.add(iri, DCTERMS.created, timestamp(latch.since_ns))
    if latch.reason:
        graph.add(iri, LF.reason, Literal(latch.reason))
