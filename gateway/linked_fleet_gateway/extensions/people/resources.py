"""The resource ``/people``: who is here, and who has control of which robot."""

from linked_fleet_gateway.api import (
    DCTERMS,
    RDFS,
    FleetBranch,
    Found,
    Graph,
    Literal,
    NamedNode,
    RequestView,
    Resource,
    Right,
    Source,
    robot_path,
    timestamp,
)
from linked_fleet_gateway.extensions.people.presence import Presence
from linked_fleet_gateway.extensions.people.terms import LF

SEGMENT = "people"
PATH = "/" + SEGMENT
RIGHTS = (Right.ACT, Right.ADMIN)


def people_branch(presence: Presence) -> FleetBranch:
    """Return the branch of the people, for those who act or administer."""

    def resolve(view: RequestView, rest: list[str]) -> Found:
        def facts() -> tuple[object, ...]:
            return tuple(sorted(presence.people.items())), tuple(sorted(_controlled(view).items()))

        def describe(graph: Graph) -> None:
            _describe(graph, view, presence.people, _controlled(view))

        return None if rest else Resource(PATH, "People", describe, source=Source(facts))

    return FleetBranch(SEGMENT, None, resolve, reading=RIGHTS)


def _controlled(view: RequestView) -> dict[str, str]:
    """Return who has control of robots, by robot."""
    return {name: each.lease.holder for name, each in view.robots.items() if each.lease is not None}


def _describe(graph: Graph, view: RequestView, here: dict[str, int], controlled: dict[str, str]) -> None:
    iri = view.iri(PATH)
    graph.a(iri, LF.People)
    graph.add(iri, DCTERMS.title, Literal("People"))
    graph.add(iri, RDFS.seeAlso, view.iri("/"))
    for name in sorted({*here, *controlled.values()}):
        node = graph.blank(LF.Person)
        graph.add(iri, LF.people, node)
        graph.add(node, DCTERMS.title, Literal(name))
        if name in here:
            graph.add(node, LF.hereSince, timestamp(here[name]))
        robots = [robot for robot, holder in controlled.items() if holder == name]
        graph.add(node, LF.controls, *(NamedNode(view.base + robot_path(robot)) for robot in robots))
