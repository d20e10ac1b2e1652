"""The list of histories, ``/history``: the history of each robot with its extent, for people who look for one."""

from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.base.errors import BadRequest
from linked_fleet_gateway.extensions.history.describe import Page, describe_extent
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.resources import SEGMENT, HistoryPage, RecordedHistory
from linked_fleet_gateway.extensions.history.span import Span
from linked_fleet_gateway.extensions.history.terms import LF
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.units import SECOND
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, RDFS
from linked_fleet_gateway.resources.branches import FleetBranch, Found, RequestView
from linked_fleet_gateway.resources.describe import Describer
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.resource import Resource, blueprint_of

HISTORIES = "/" + SEGMENT


@dataclass(frozen=True)
class _Listed:
    robot: Robot
    page: Page


def list_branch(history: History) -> FleetBranch:
    """Return the branch of the list, of the robots that the caller sees."""

    def resolve(view: RequestView, rest: list[str]) -> Found:
        found = _list(history, view)
        if rest == ["blueprint"]:
            return blueprint_of(found, view.base, (LF.HistoryListShape,))
        return None if rest else found

    return FleetBranch(SEGMENT, LF.histories, resolve)


def _list(history: History, view: RequestView) -> Resource:
    own = (HISTORIES + "/blueprint",)

    def shown(span: Span) -> HistoryPage:
        """Read the extents here, since the thread that renders them must not read tracks that grow."""
        if span != Span():
            raise BadRequest("The list of histories has no spans; each history in it has.")
        robots = [each for each in view.robots.values() if each.model is not None and history.span_s]
        listed = [_Listed(each, _extent(history, each)) for each in robots]

        def describe(graph: Graph) -> None:
            _describe(graph, view, history.span_s, listed)

        resource = Resource(HISTORIES, "History", describe, own=own, followed=False)
        return HistoryPage(resource, Page(span), Page(span))

    return Resource(HISTORIES, "History", None, own=own, remote=RecordedHistory(history, shown))


def _extent(history: History, robot: Robot) -> Page:
    track = history.track(robot)
    return Page(Span()) if track is None else Page(Span(), None, track.ends, len(track))


def _describe(graph: Graph, view: RequestView, span_s: float, listed: Sequence[_Listed]) -> None:
    iri, say = view.iri(HISTORIES), Describer(view.base)
    graph.a(iri, LF.HistoryList)
    graph.add(iri, DCTERMS.title, Literal("History"))
    graph.add(iri, RDFS.seeAlso, view.iri("/"))
    graph.add(iri, HYBRIT.blueprint, LF.HistoryListShape, NamedNode(iri.value + "/blueprint"))
    graph.scalar(iri, LF.historySpan, span_s, SECOND)
    for each in listed:
        robot, path = view.iri(robot_path(each.robot.name)), robot_path(each.robot.name) + SEGMENT
        own = view.iri(path)
        graph.add(iri, DCTERMS.hasPart, own)
        graph.a(own, LF.History)
        graph.add(own, DCTERMS.title, Literal(f"History of {each.robot.name}"))
        graph.add(own, LF.ofRobot, robot)
        describe_extent(graph, own, each.page)
        graph.add(robot, DCTERMS.title, Literal(each.robot.title))
        say.presence(graph, robot, each.robot)
