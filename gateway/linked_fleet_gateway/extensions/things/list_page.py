"""A page of the directory in RDF: things with their names and classes, in the order of their ids."""

from collections.abc import Sequence

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.extensions.things.directory import Place
from linked_fleet_gateway.extensions.things.td import DIRECTORY
from linked_fleet_gateway.extensions.things.terms import LF
from linked_fleet_gateway.fleet.model import Joint
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LDP, RDFS, ROS, XHV
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.joint_kinds import kind_of

MOST_LISTED = 200
"""Most things on one page."""


def describe_page(
    view: RequestView, things: Sequence[tuple[str, Place]], offset: int, limit: int, graph: Graph
) -> None:
    iri = view.iri(DIRECTORY)
    graph.a(iri, LF.Directory, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal("Things"))
    graph.add(iri, RDFS.seeAlso, view.iri("/"))
    end = offset + limit
    if offset:
        graph.add(iri, XHV.prev, view.iri(f"{DIRECTORY}?offset={max(0, offset - limit)}&limit={limit}"))
    if end < len(things):
        graph.add(iri, XHV.next, view.iri(f"{DIRECTORY}?offset={end}&limit={limit}"))
    for id, place in things[offset:end]:
        thing, (robot, part) = NamedNode(id), place
        graph.add(iri, LDP.contains, thing)
        if robot is None:
            graph.a(thing, LF.Fleet)
            graph.add(thing, DCTERMS.title, Literal("Linked Fleet"))
        elif part is None:
            graph.a(thing, LF.Robot)
            graph.add(thing, DCTERMS.title, Literal(robot.title))
        else:
            graph.a(thing, kind_of(part).type if isinstance(part, Joint) else ROS.Link)
            graph.add(thing, DCTERMS.title, Literal(part.name))
