"""The page of the world: the robots that are placed in it, and the objects among them."""

from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import BlankNode, NamedNode

from linked_fleet_gateway.extensions.pages import labels
from linked_fleet_gateway.extensions.pages.thing_views import path_below
from linked_fleet_gateway.extensions.pages.values import Facts, Link
from linked_fleet_gateway.extensions.pages.views import PageView, Part
from linked_fleet_gateway.extensions.world.describe import OBJECTS
from linked_fleet_gateway.rdf.turtle_layout import Term
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LF, MATHS


@dataclass(frozen=True)
class PlacedRobot:
    """A robot in the world; addresses of what draws it, empty where it has not said what it is."""

    link: Link
    name: str
    placement: str
    placed: bool
    model: str
    state: str
    pose: str


def world(facts: Facts, iri: NamedNode) -> Part:
    robots = [each for each in facts.all(iri, DCTERMS.hasPart) if isinstance(each, NamedNode)]
    placements = {each: facts.one(each, LF.placement) for each in robots}
    standing = [_standing(facts, each, placements[each]) for each in robots]
    more = {"robots": standing, "objects": path_below(getattr(facts.one(iri, LF.objects), "value", ""), facts.root)}
    done = {each for each in (*robots, *placements.values()) if isinstance(each, NamedNode)}
    return Part(more, {DCTERMS.hasPart}, done)


def _standing(facts: Facts, iri: NamedNode, placement: Term | None) -> PlacedRobot:
    def address(predicate: NamedNode) -> str:
        return path_below(getattr(facts.one(iri, predicate), "value", ""), facts.root)

    position = facts.one(placement, LF.position) if isinstance(placement, NamedNode) else None
    x = facts.one(position, MATHS.x) if isinstance(position, BlankNode) else None
    name = labels.place(iri.value, facts.root)
    return PlacedRobot(
        facts.link(iri), name, address(LF.placement), x != LF.unknown, address(LF.model), address(LF.jointState),
        address(LF.pose),
    )  # fmt: skip


VIEW = PageView(LF.World, Path(__file__).parent / "templates" / "world.html", world, constants={"objects": OBJECTS})
