"""Histories as Linked Data, and their terms: the extent of a robot's history, and observations (SOSA) of a property.

Clients build no URLs: each description links the last seconds and the next page, and has a template (Hydra) for any
other part.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.span import Span, lexical_time, query
from linked_fleet_gateway.extensions.history.track import Excerpt, Numbers, Series, Track
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import (
    METRE,
    METRE_PER_SECOND,
    RADIAN_PER_SECOND,
    SECOND,
    Graph,
    integer,
    number,
    timestamp,
)
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, HYDRA, QUDT, RDFS, SOSA
from linked_fleet_gateway.rdf.vocabulary import LF as CORE
from linked_fleet_gateway.resources.describe import Describer
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.property import Property

LF = CORE.extended(
    "History HistoryList HistoryListShape HistoryShape histories history historySpan samplingPeriod oldestSample "
    "newestSample sampleCount from to last limit"
)

_READY = {"the last 10 s": "PT10S", "the last minute": "PT1M"}
_VARIABLES = {
    "from": (LF.from_, "xsd:dateTime; samples from then on"),
    "to": (LF.to, "xsd:dateTime; samples before then"),
    "last": (LF.last, "xsd:duration; length of the span up to the newest sample"),
    "limit": (LF.limit, "maximum number of samples: the first ones of a span, or the newest if it has no beginning"),
}


@dataclass(frozen=True)
class Page:
    """One page of a history, and the queries of adjacent pages; ``time_range`` and ``count`` are those of the whole
    history.
    """

    span: Span
    excerpt: Excerpt | None = None
    time_range: tuple[int, int] | None = None
    count: int = 0

    @property
    def next(self) -> str:
        """The query of the following page of a span with a beginning; empty if there is none."""
        after = None if self.excerpt is None else self.excerpt.after
        if after is None or not self.span.forward:
            return ""
        end = {} if self.span.end_ns is None else {"to": lexical_time(self.span.end_ns)}
        return query(from_=lexical_time(after), **end, **self._limit)

    @property
    def previous(self) -> str:
        """The query of the preceding page if the newest samples were requested; empty if there is none."""
        excerpt = self.excerpt
        if excerpt is None or excerpt.before is None or self.span.forward:
            return ""
        return query(to=lexical_time(excerpt.before + 1), **self._limit)

    @property
    def _limit(self) -> dict[str, int]:
        return {} if self.span.limit is None else {"limit": self.span.limit}


def page_of(track: Track | None, span: Span, most: int) -> Page:
    """Return the requested part of a track, with at most ``most`` samples."""
    if track is None or track.time_range is None:
        return Page(span)
    excerpt = track.excerpt(span.begin(track.time_range[1]), span.end_ns, most)
    return Page(span, excerpt, track.time_range, len(track))


def describe_robot(
    graph: Graph, base: str, iri: NamedNode, robot: Robot, history: History, page: Page,
    parts: Sequence[tuple[NamedNode, NamedNode]],
) -> None:  # fmt: skip
    """Describe the history of a robot: its extent, its files, and the histories of its properties.

    ``parts`` are pairs of a property and its history. The presence of the robot says whether samples are added.
    """
    say, path = Describer(base), robot_path(robot.name)
    about = say.iri(path)
    graph.a(iri, LF.History)
    graph.add(iri, DCTERMS.title, Literal(f"History of {robot.name}"))
    graph.add(iri, RDFS.seeAlso, about)
    graph.add(iri, LF.ofRobot, about)
    say.presence(graph, about, robot)
    graph.add(about, LF.jointState, say.iri(path + "jointState"))
    graph.add(iri, HYBRIT.blueprint, LF.HistoryShape, NamedNode(iri.value + "/blueprint"))
    graph.scalar(iri, LF.historySpan, history.span_s, SECOND)
    graph.scalar(iri, LF.samplingPeriod, 1 / history.rate_hz, SECOND)
    describe_extent(graph, iri, page)
    for title, span in _READY.items():
        _view(graph, iri, f"?last={span}&as=csv", f"{title}, joint states", CSV)
    _view(graph, iri, "?as=csv", "all joint states", CSV)
    _view(graph, iri, "?as=mcap", "all joint states and the model", MCAP)
    _search(graph, iri)
    for of, part in parts:
        graph.add(iri, DCTERMS.hasPart, part)
        graph.add(of, LF.history, part)


def describe_property(
    graph: Graph, iri: NamedNode, of: NamedNode, thing: NamedNode, whole: NamedNode, item: Property,
    series: Series | None, page: Page,
) -> None:  # fmt: skip
    """Describe the observations of the property ``of`` on ``page``; ``whole`` is the history of the robot."""
    graph.a(iri, LF.History, SOSA.ObservationCollection)
    graph.add(iri, DCTERMS.title, Literal(f"History of {item.title}"))
    graph.add(iri, RDFS.seeAlso, of, whole)
    graph.add(iri, SOSA.observedProperty, of)
    graph.add(iri, SOSA.hasFeatureOfInterest, thing)
    graph.add(iri, HYBRIT.blueprint, LF.HistoryShape, NamedNode(iri.value + "/blueprint"))
    describe_extent(graph, iri, page)
    for title, span in _READY.items():
        _view(graph, iri, f"?last={span}", title)
    _search(graph, iri)
    for relation, part in ((HYDRA.next, page.next), (HYDRA.previous, page.previous)):
        if part:
            graph.add(iri, relation, NamedNode(f"{iri.value}?{part}"))
    if series is None or page.excerpt is None:
        return
    if len(series.columns) == 1:
        graph.add(iri, QUDT.unit, series.columns[0][1].qudt)
    for stamp_ns, values in series.samples(page.excerpt):
        one = graph.blank(SOSA.Observation)
        graph.add(iri, SOSA.hasMember, one)
        graph.add(one, SOSA.resultTime, timestamp(stamp_ns))
        _result(graph, one, item, values)


def _result(graph: Graph, one: BlankNode, item: Property, values: Numbers) -> None:
    """Add a result: a single number as simple result, several numbers as in the description of the property."""
    if len(values) == 1:
        graph.add(one, SOSA.hasSimpleResult, number(values[0]))
        return
    result = graph.blank()
    graph.add(one, SOSA.hasResult, result)
    if item.shape == LF.PoseShape:
        graph.vector(result, LF.position, values[:3], METRE)
        graph.quaternion(result, LF.orientation, values[3:])
    else:
        graph.vector(result, LF.linear, values[:3], METRE_PER_SECOND)
        graph.vector(result, LF.angular, values[3:], RADIAN_PER_SECOND)


def describe_extent(graph: Graph, iri: NamedNode, page: Page) -> None:
    """Add the times of the oldest and newest sample, and the number of samples."""
    for term, end in ((LF.oldestSample, 0), (LF.newestSample, 1)):
        graph.add(iri, term, LF.unknown if page.time_range is None else timestamp(page.time_range[end]))
    graph.add(iri, LF.sampleCount, integer(page.count))


def _view(graph: Graph, iri: NamedNode, query: str, title: str, media_type: str = "") -> None:
    part = NamedNode(iri.value + query)
    graph.add(iri, HYDRA.view, part)
    graph.add(part, DCTERMS.title, Literal(title))
    if media_type:
        graph.add(part, DCTERMS.format, Literal(media_type))


def _search(graph: Graph, iri: NamedNode) -> None:
    """Add an RFC 6570 template in the Hydra vocabulary."""
    template = graph.blank(HYDRA.IriTemplate)
    graph.add(iri, HYDRA.search, template)
    graph.add(template, HYDRA.template, Literal(f"{iri.value}{{?{','.join(_VARIABLES)}}}"))
    for name, (predicate, meaning) in _VARIABLES.items():
        mapping = graph.blank(HYDRA.IriTemplateMapping)
        graph.add(template, HYDRA.mapping, mapping)
        graph.add(mapping, HYDRA.variable, Literal(name))
        graph.add(mapping, HYDRA.property, predicate)
        graph.add(mapping, DCTERMS.description, Literal(meaning))
