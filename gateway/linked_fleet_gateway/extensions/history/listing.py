"""The list of the histories of all robots, ``/history``, for people who look for one."""

from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode

from linked_fleet_base.errors import BadRequest
from linked_fleet_gateway.api import FleetBranch, Found, RequestView, Resource, Robot, blueprint_of, robot_path
from linked_fleet_gateway.extensions.history.beyond import with_extent
from linked_fleet_gateway.extensions.history.describe import LF, Page, describe_disk, describe_extent, extent
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.resources import SEGMENT, HistoryPage, RecordedHistory
from linked_fleet_gateway.extensions.history.span import Span
from linked_fleet_gateway.faces import Describer
from linked_fleet_rdf.graph import SECOND, Graph
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, RDFS
from linked_fleet_rdf.vocabulary import LF as CORE_LF

HISTORIES = "/" + SEGMENT


_LIST = "the list of histories"


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
        listed = list[_Listed]()
        for each in robots:
            with view.faults.guard(_LIST, each.name):
                listed.append(_Listed(each, _extent(history, each)))

        def describe(graph: Graph) -> None:
            _describe(graph, view, history, listed)

        resource = Resource(HISTORIES, "History", describe, own_paths=own, publishes_changes=False)
        return HistoryPage(resource, Page(span), Page(span))

    return Resource(HISTORIES, "History", None, own_paths=own, remote=RecordedHistory(history, shown))


def _extent(history: History, robot: Robot) -> Page:
    track = history.track(robot)
    page = Page(Span()) if track is None else Page(Span(), None, track.time_range, len(track))
    return with_extent(history.archive, robot.name, page)


def _describe(graph: Graph, view: RequestView, history: History, listed: Sequence[_Listed]) -> None:
    iri, say = view.iri(HISTORIES), Describer(view.base)
    graph.a(iri, LF.HistoryList)
    graph.add(iri, DCTERMS.title, Literal("History"))
    graph.add(iri, RDFS.seeAlso, view.iri("/"))
    graph.add(iri, HYBRIT.blueprint, LF.HistoryListShape, NamedNode(iri.value + "/blueprint"))
    graph.scalar(iri, LF.historySpan, history.span_s, SECOND)
    describe_disk(graph, iri, history)
    for each in listed:
        with view.faults.guard(_LIST, each.robot.name, "its row"):
            _describe_row(graph, view, say, each)
    for name in view.robots:
        if reason := view.faults.find(_LIST, name) or view.faults.find(_LIST, name, "its row"):
            graph.add(view.iri(robot_path(name)), CORE_LF.fault, Literal(reason))


def _describe_row(graph: Graph, view: RequestView, say: Describer, each: _Listed) -> None:
    iri = view.iri(HISTORIES)
    robot, path = view.iri(robot_path(each.robot.name)), robot_path(each.robot.name) + SEGMENT
    own = view.iri(path)
    graph.add(iri, DCTERMS.hasPart, own)
    graph.a(own, LF.History)
    graph.add(own, DCTERMS.title, Literal(f"History of {each.robot.name}"))
    graph.add(own, LF.ofRobot, robot)
    describe_extent(graph, own, extent(each.page))
    graph.add(robot, DCTERMS.title, Literal(each.robot.title))
    say.presence(graph, robot, each.robot)
