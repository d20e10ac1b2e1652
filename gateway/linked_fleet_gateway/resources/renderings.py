"""Compiled renderings of measured values, and the bodies of messages.

A description is rendered once by ``Resource.describe_measured`` with random marker values. Their positions in the
document are the places into which values are written. So a compiled rendering always gives the document that
``describe_measured`` gives. The body of a message is the representation that GET returns, plus the version of the
resource.
"""

import math
import random
from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import NamedTuple

from pyoxigraph import NamedNode

from linked_fleet_gateway.fleet.observation import Mark, Observation
from linked_fleet_gateway.rdf.graph import Graph, lexical, timestamp
from linked_fleet_gateway.rdf.serialise import RDF_TYPES, TEXT_TYPES, WriteError
from linked_fleet_gateway.rdf.templates import Template, render_graph
from linked_fleet_gateway.rdf.vocabulary import PREFIXES
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_gateway.resources.property import Measurement
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription_resource import describe_version

_MILLISECOND_NS = 1_000_000
_HOUR_NS = 3_600_000_000_000
_FAR = 52_500_000  # an hour in the year 7959
_END = "7e+211"
_random = random.SystemRandom()  # unpredictable, so that a robot cannot describe itself with the marker values


class Versions(NamedTuple):
    """The versions that a message states (``describe_version``)."""

    version: str
    event_id: str
    previous: str | None


class _Form(NamedTuple):
    """The state that determines the constant text: unknown values, marks of values, and optional statements.

    Each field has one tuple for each of ``Resource.samplers`` and ``Resource.silent_samplers``.
    """

    unknown: tuple[tuple[bool, ...], ...]
    marks: tuple[tuple[Mark, ...], ...]
    timed: tuple[bool, ...]
    versions: int


class Rendering:
    """A measured resource in one media type under one base URL, valid while its facts do not change."""

    def __init__(self, resource: Resource, media_type: str, base: str) -> None:
        self._resource, self._media_type, self._base = resource, media_type, base
        self._counts: tuple[int, ...] = ()
        self._form: _Form | None = None
        self._template = Template([""], ())
        """Its values are those measured, then times, then versions."""

    def render_current(self) -> bytes:
        """Return the document with the present values. Raises WriteError if the syntax cannot express it."""
        return self.render(
            [
                Measurement.from_observations(sample())
                for sample in (*self._resource.samplers, *self._resource.silent_samplers)
            ]
        )

    def render_observations(self, observations: Sequence[Observation], versions: Versions | None = None) -> bytes:
        """Return the document with the observations of a reading: those of all ``samplers``, in their order.

        A reading has no observations of ``silent_samplers``; they are read here.
        """
        quiet = self._resource.silent_samplers
        if len(self._resource.samplers) == 1 and not quiet:
            return self.render([Measurement.from_observations(observations)], versions)
        if len(self._counts) != len(self._resource.samplers) or sum(self._counts) != len(observations):
            self._counts = tuple(len(sample()) for sample in self._resource.samplers)
        ends = tuple(accumulate(self._counts, initial=0))
        measurements = [Measurement.from_observations(observations[at:to]) for at, to in pairwise(ends)]
        return self.render([*measurements, *(Measurement.from_observations(sample()) for sample in quiet)], versions)

    def render(self, measurements: Sequence[Measurement], versions: Versions | None = None) -> bytes:
        """Return the document with these values, one for each of ``samplers`` and ``silent_samplers``.

        Raises WriteError as ``render_current``.
        """
        said = 0 if versions is None else 2 if versions.previous is None else 3
        form = _Form(
            tuple([tuple([value != value for value in seen.values]) for seen in measurements]),
            tuple([seen.marks for seen in measurements]),
            tuple([seen.wall_ns is not None for seen in measurements]),
            said,
        )
        if form != self._form:
            self._template, self._form = self._compile(form), form
        texts = [lexical(value) for seen in measurements for value in seen.values]
        texts += [lexical_time(seen.wall_ns) if seen.wall_ns is not None else "" for seen in measurements]
        if versions is not None:
            texts += (versions.version, versions.event_id, versions.previous or "")
        return self._template.fill(texts)

    def _compile(self, form: _Form) -> Template:
        markers = _Markers(sum(map(len, form.unknown)), len(form.timed))
        measurements, first = list[Measurement](), 0
        for look, (of_look, marks, timed) in enumerate(zip(form.unknown, form.marks, form.timed, strict=True)):
            values = [math.nan if unknown else markers.value(index) for index, unknown in enumerate(of_look, first)]
            measurements.append(Measurement(tuple(values), markers.time_ns(look) if timed else None, marks))
            first += len(of_look)
        graph = Graph()
        assert self._resource.describe_measured is not None
        self._resource.describe_measured(graph, measurements)
        self._resource.add_interaction_model(graph, self._base)
        if form.versions:
            iri = NamedNode(self._base + self._resource.path)
            describe_version(graph, iri, *(markers.version(index) for index in range(form.versions)))
        body = render_graph(graph, self._media_type, PREFIXES, base=self._base + self._resource.path)
        return markers.template(body.content.decode())


class _Markers:
    """Marker values, times and versions of one document. All of a kind begin alike, and have an index of fixed length.

    Indices in the template are those of values, then of times, then of versions.
    """

    def __init__(self, values: int, times: int) -> None:
        self._values, self._times = values, times
        self._hour_ns = (_FAR + _random.randrange(10**6)) * _HOUR_NS
        self._value = f"8.{_random.randrange(10**7):07}"
        self._time = timestamp(self._hour_ns).value[: -len("00:00.000Z")]
        self._version = f"{_random.getrandbits(64):016x}"

    def value(self, index: int) -> float:
        return float(f"{self._value}{index:06}7e211")

    def time_ns(self, index: int) -> int:
        return self._hour_ns + index * _MILLISECOND_NS

    def version(self, index: int) -> str:
        return f"{self._version}{index}"

    def template(self, document: str) -> Template:
        """Return the document with places where it has markers."""
        for kind, start in zip("vts", (self._value, self._time, self._version), strict=True):
            document = document.replace(start, f"\0{kind}")  # no document contains a NUL
        first, *marked = document.split("\0")
        pieces, places = [first], list[int]()
        for piece in marked:
            match piece[0]:
                case "v" if piece[7:13] == _END:  # v000012 7e+211
                    places.append(int(piece[1:7]))
                    pieces.append(piece[13:])
                case "v":  # another number that begins so
                    pieces[-1] += self._value + piece[1:]
                case "t":  # t00:00.012Z
                    places.append(self._values + (int(piece[1:3]) * 60 + int(piece[4:6])) * 1000 + int(piece[7:10]))
                    pieces.append(piece[11:])
                case _:
                    places.append(self._values + self._times + int(piece[1]))
                    pieces.append(piece[2:])
        return Template(pieces, places)


def is_compilable(resource: Resource, media_type: str) -> bool:
    """Return True if a ``Rendering`` is possible. Binary syntaxes are excluded, because they store text lengths."""
    return resource.describe_measured is not None and bool(resource.samplers) and media_type in TEXT_TYPES


@lru_cache(maxsize=64)
def _second(second: int) -> str:
    return timestamp(second * 1_000_000_000).value[:-4]


def lexical_time(wall_ns: int) -> str:
    """Format a time as ``timestamp`` does, with a cached part per second."""
    second, rest_ns = divmod(wall_ns, 1_000_000_000)
    return f"{_second(second)}{rest_ns // _MILLISECOND_NS:03d}Z"


MAX_RENDERINGS = 4096


class Renderings:
    """Bounded, oldest dropped first. A rendering is compiled again when the facts of its resource change."""

    def __init__(self, max_renderings: int = MAX_RENDERINGS) -> None:
        self._most = max_renderings
        self._kept: dict[tuple[str, str, str], tuple[object, Rendering]] = {}

    def rendering(self, resource: Resource, media_type: str, base: str) -> Rendering:
        """Return the rendering of a resource for which ``is_compilable`` is true."""
        key, facts = (base, resource.path, media_type), resource.source.facts()
        kept = self._kept.get(key)
        if kept is None or kept[0] != facts:
            self._kept.pop(key, None)
            while len(self._kept) >= self._most:
                del self._kept[next(iter(self._kept))]
            kept = self._kept[key] = (facts, Rendering(resource, media_type, base))
        return kept[1]

    def forget_robot(self, robot: str) -> None:
        """Drop the renderings of a robot that was removed."""
        for key in [key for key in self._kept if robot_of(key[1]) == robot]:
            del self._kept[key]

    def __len__(self) -> int:
        return len(self._kept)


def message_types(resource: Resource) -> tuple[str, ...]:
    """Return the media types of messages about ``resource``: no HTML, and Turtle first (R1.2)."""
    if not resource.observable:
        return ()
    return (*RDF_TYPES, *(each for each in resource.documents if each not in resource.constant_media_types))


def message_body(resource: Resource, media_type: str, base: str, versions: Versions) -> bytes:
    """Return the bytes of a message. Raises WriteError if the syntax cannot represent the triples."""
    if media_type in resource.documents:
        return resource.documents[media_type]()
    if media_type not in RDF_TYPES:
        raise WriteError(f"there is no {media_type} of {resource.path} at present")
    graph = resource.full_graph(base)
    describe_version(graph, NamedNode(base + resource.path), *versions)
    return render_graph(graph, media_type, PREFIXES, base=base + resource.path).content
