"""Histories as Linked Data, and their terms: the extent of a robot's history, and observations (SOSA) of a property.

Clients build no URLs: each description links the last seconds and the next page, and has a template (Hydra) for any
other part.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.api import Property
from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.span import Span, lexical_duration, lexical_time, query
from linked_fleet_gateway.extensions.history.thinning import GAP_NS, is_gap
from linked_fleet_gateway.extensions.history.track import Excerpt, Series, Track, wall_ns
from linked_fleet_gateway.faces import Describer
from linked_fleet_rdf.graph import (
    METRE,
    METRE_PER_SECOND,
    QUATERNION_AXES,
    RADIAN_PER_SECOND,
    SECOND,
    VECTOR_AXES,
    Graph,
    Term,
    Unit,
    integer,
    number,
    timestamp,
)
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, HYDRA, MATHS, QUDT, RDFS, SOSA
from linked_fleet_rdf.vocabulary import LF as CORE
from linked_fleet_state.robot import Robot

LF = CORE.extended(
    "History HistoryList HistoryListShape HistoryShape histories history historySpan samplingPeriod oldestSample "
    "newestSample sampleCount from to last limit every at diskSpan "
    "ComponentHistory ComponentHistoryShape componentHistory"
)

_READY = {"the last 10 s": "PT10S", "the last minute": "PT1M"}
_VARIABLES = {
    "from": (LF.from_, "xsd:dateTime; samples from then on"),
    "to": (LF.to, "xsd:dateTime; samples before then"),
    "last": (LF.last, "xsd:duration; length of the span up to the newest sample"),
    "at": (LF.at, "xsd:dateTime; the single sample that held then, instead of a span"),
    "every": (LF.every, "xsd:duration; the least time between two samples, of which others are left out"),
    "limit": (LF.limit, "maximum number of samples: the first ones of a span, or the newest if it has no beginning"),
}


Extent = tuple[Literal | NamedNode, Literal | NamedNode, Literal]
"""The times of the oldest and newest sample, and the number of samples."""


@dataclass(frozen=True)
class Page:
    """One page of a history, and the queries of adjacent pages.

    ``time_range`` is that of the whole history, ``count`` the number of its samples in memory.
    """

    span: Span
    excerpt: Excerpt | None = None
    time_range: tuple[int, int] | None = None
    count: int = 0
    urdf: str = ""
    """The URDF of the robot then, if it was read from disk."""

    @property
    def next(self) -> str:
        """The query of the following page of a span with a beginning; empty if there is none."""
        after = None if self.excerpt is None else self.excerpt.after
        if after is None or not self.span.forward:
            return ""
        end = {} if self.span.end_ns is None else {"to": lexical_time(self.span.end_ns)}
        return query(from_=lexical_time(after), **end, **self._size)

    @property
    def previous(self) -> str:
        """The query of the preceding page if the newest samples were requested; empty if there is none."""
        excerpt = self.excerpt
        if excerpt is None or excerpt.before is None or self.span.forward:
            return ""
        return query(to=lexical_time(excerpt.before + 1), **self._size)

    @property
    def adjacent(self) -> tuple[NamedNode, str]:
        """Relation and query of the adjacent page; an empty query if there is none."""
        return (HYDRA.next, self.next) if self.span.forward else (HYDRA.previous, self.previous)

    @property
    def _size(self) -> dict[str, str | int]:
        """Return the parameters by which a page is as long as this one."""
        limit = {} if self.span.limit is None else {"limit": self.span.limit}
        every = {} if self.span.every_ns is None else {"every": lexical_duration(self.span.every_ns)}
        return limit | every


def page_of(track: Track | None, span: Span, most: int) -> Page:
    """Return the requested part of a track, with at most ``most`` samples."""
    if track is None or track.time_range is None:
        return Page(span)
    begin_ns, end_ns = span.begin(track.time_range[1]), span.end_ns
    if span.at_ns is not None:
        return Page(span, _held(track, span.at_ns), track.time_range, len(track))
    return Page(span, track.excerpt(begin_ns, end_ns, most), track.time_range, len(track))


def _held(track: Track, at_ns: int) -> Excerpt:
    """Return the frame that held at a time, if the robot was heard then."""
    found = track.excerpt(None, at_ns + 1, 1)
    heard = found.frames and at_ns - wall_ns(found.frames[0]) <= GAP_NS and not is_gap(found.frames[0])
    return Excerpt(track.joints, found.frames if heard else ())


def describe_robot(
    graph: Graph, base: str, path: str, robot: Robot, history: History, about: tuple[Literal, Extent],
    parts: Sequence[str],
) -> None:  # fmt: skip
    """Describe the history of the robot at ``path``: its extent, its files, and the histories of its properties.

    ``about``: its title and extent. ``parts``: the paths of properties below the robot. The presence of the robot says
    whether samples are added.
    """
    say = Describer(base)
    robot_iri, iri = say.iri(path), say.iri(f"{path}history")
    graph.a(iri, LF.History)
    graph.add(iri, DCTERMS.title, about[0])
    graph.add(iri, RDFS.seeAlso, robot_iri)
    graph.add(iri, LF.ofRobot, robot_iri)
    say.presence(graph, robot_iri, robot)
    graph.add(robot_iri, LF.jointState, say.iri(path + "jointState"))
    graph.add(iri, HYBRIT.blueprint, LF.HistoryShape, NamedNode(iri.value + "/blueprint"))
    graph.scalar(iri, LF.historySpan, history.span_s, SECOND)
    graph.scalar(iri, LF.samplingPeriod, 1 / history.rate_hz, SECOND)
    describe_disk(graph, iri, history)
    if history.archive is not None:
        graph.add(iri, LF.componentHistory, NamedNode(f"{iri.value}/values"))
    describe_extent(graph, iri, about[1])
    for title, span in _READY.items():
        _view(graph, iri, f"?last={span}&as=csv", f"{title}, joint states", CSV)
    _view(graph, iri, "?as=csv", "all joint states", CSV)
    _view(graph, iri, "?as=mcap", "all joint states and the model", MCAP)
    _search(graph, iri)
    for each in parts:
        of = path + each
        graph.add(iri, DCTERMS.hasPart, say.iri(f"{of}/history"))
        graph.add(say.iri(of), LF.history, say.iri(f"{of}/history"))


def describe_property(
    graph: Graph, iri: NamedNode, of: NamedNode, thing: NamedNode, whole: NamedNode, item: Property,
    series: Series | None, page: Page,
) -> None:  # fmt: skip
    """Describe the observations of the property ``of`` on ``page``; ``whole`` is the history of the robot."""
    unit = None if series is None or page.excerpt is None or len(series.columns) > 1 else series.columns[0][1].qudt
    about = About(Literal(f"History of {item.title}"), extent(page), *page.adjacent, unit)
    describe_collection(graph, iri, of, thing, whole, about)
    if series is None or page.excerpt is None:
        return
    for stamp_ns, values in series.samples(page.excerpt):
        one = describe_observation(graph, iri, timestamp(stamp_ns))
        describe_result(graph, one, item.shape, [number(each) for each in values])


@dataclass(frozen=True)
class About:
    """The statements about a page that differ between histories. ``query``: that of the adjacent page, if any."""

    title: Literal
    extent: Extent
    relation: NamedNode
    query: str
    unit: NamedNode | None


def describe_collection(
    graph: Graph, iri: NamedNode, of: NamedNode, thing: NamedNode, whole: NamedNode, about: About
) -> None:
    """Describe a page of observations, without them."""
    graph.a(iri, LF.History, SOSA.ObservationCollection)
    graph.add(iri, DCTERMS.title, about.title)
    graph.add(iri, RDFS.seeAlso, of, whole)
    graph.add(iri, SOSA.observedProperty, of)
    graph.add(iri, SOSA.hasFeatureOfInterest, thing)
    graph.add(iri, HYBRIT.blueprint, LF.HistoryShape, NamedNode(iri.value + "/blueprint"))
    describe_extent(graph, iri, about.extent)
    for title, span in _READY.items():
        _view(graph, iri, f"?last={span}", title)
    _search(graph, iri)
    if about.query:
        graph.add(iri, about.relation, NamedNode(f"{iri.value}?{about.query}"))
    if about.unit is not None:
        graph.add(iri, QUDT.unit, about.unit)


def describe_observation(graph: Graph, iri: NamedNode, stamp: Literal) -> BlankNode:
    """Add an observation to a page, and return it. Its result is added by the caller."""
    one = graph.blank(SOSA.Observation)
    graph.add(iri, SOSA.hasMember, one)
    graph.add(one, SOSA.resultTime, stamp)
    return one


def describe_result(graph: Graph, one: BlankNode, shape: NamedNode, terms: Sequence[Term]) -> None:
    """Add a result: a single number as simple result, several numbers as in the description of the property."""
    if len(terms) == 1:
        graph.add(one, SOSA.hasSimpleResult, terms[0])
        return
    result = graph.blank()
    graph.add(one, SOSA.hasResult, result)
    if shape == LF.PoseShape:
        _vector(graph, result, LF.position, terms[:3], METRE)
        graph.components(result, LF.orientation, LF.Quaternion, QUATERNION_AXES, terms[3:])
    else:
        _vector(graph, result, LF.linear, terms[:3], METRE_PER_SECOND)
        _vector(graph, result, LF.angular, terms[3:], RADIAN_PER_SECOND)


def _vector(graph: Graph, node: BlankNode, predicate: NamedNode, terms: Sequence[Term], unit: Unit) -> None:
    graph.unit(graph.components(node, predicate, MATHS.Vector3D, VECTOR_AXES, terms), unit)


def describe_disk(graph: Graph, iri: NamedNode, history: History) -> None:
    """Add for how long samples are kept on disk, and what is wrong with it."""
    if (archive := history.archive) is not None:
        graph.scalar(iri, LF.diskSpan, archive.keep_s, SECOND)
    for each in history.findings:
        graph.add(iri, CORE.fault, Literal(each))


def extent(page: Page) -> Extent:
    ends = page.time_range
    oldest, newest = (LF.unknown, LF.unknown) if ends is None else (timestamp(ends[0]), timestamp(ends[1]))
    return oldest, newest, integer(page.count)


def describe_extent(graph: Graph, iri: NamedNode, terms: Extent) -> None:
    """Add the times of the oldest and newest sample, and the number of samples."""
    for predicate, term in zip((LF.oldestSample, LF.newestSample, LF.sampleCount), terms, strict=True):
        graph.add(iri, predicate, term)


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
