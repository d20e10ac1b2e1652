"""Descriptions of a resource: by a function, perhaps in steps, or by a template, into which its values are put anew.

A template is a description with places: ``describe`` adds all triples, with given literals in place of values. It is
executed once with markers (``resources/templates.py``). There are two kinds of values: those that resources of one kind
do not share, and measured ones.
"""

import math
import re
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import accumulate, pairwise

from msgspec import Struct
from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.resources.property import Measurement, Sampler
from linked_fleet_rdf.graph import Graph, Number, lexical, timestamp
from linked_fleet_rdf.templates import Markers, is_replaceable
from linked_fleet_rdf.vocabulary import XSD
from linked_fleet_state.observation import Observation

Describe = Callable[[Graph], None]
Values = tuple[Hashable, list[str]]
"""The form of a document, which is all that decides its constant text, and the texts of its values."""
# Excludes characters that some syntax escapes, and segments that look like a prefix or a relative reference.
_PLAIN = re.compile(r"(/[A-Za-z0-9_~][A-Za-z0-9_~-]*)+/?", re.ASCII)
_MILLISECOND_NS = 1_000_000
REPEATED = 3
"""Documents with so many rows or more differ in their number alone."""


class InSteps(Struct, frozen=True):
    """A description that takes long; ``steps`` adds its triples in steps of a millisecond at most."""

    steps: Callable[[Graph], Iterator[None]]

    def __call__(self, graph: Graph) -> None:
        run_steps(self.steps(graph))


def run_steps(steps: Iterable[None]) -> None:
    """Execute all steps at once."""
    deque(steps, maxlen=0)


class Rows(Struct, frozen=True):
    """The values of statements that are repeated any number of times: datatypes of a row, and the texts of all rows.

    Texts are such that ``is_replaceable`` is true of them.
    """

    datatypes: tuple[NamedNode, ...]
    texts: Sequence[str]

    @property
    def count(self) -> int:
        return len(self.texts) // len(self.datatypes)

    def literals(self) -> list[Literal]:
        datatypes = self.datatypes * self.count
        return [Literal(text, datatype=datatype) for text, datatype in zip(self.texts, datatypes, strict=True)]


class DescriptionTemplate(Struct, frozen=True):
    """The description of resources of one kind, which differ only in the path of their owner and in values.

    ``key`` identifies the kind, which a resource shares with others that have values of the same datatypes.
    ``describe`` describes the resource of the owner at the given path, with the given literals as values. ``literals``
    returns those of this resource.
    """

    key: object
    owner: str
    describe: Callable[[Graph, str, Sequence[Literal]], None]
    literals: Callable[[], Sequence[Literal]] = tuple
    rows: Rows | None = None
    """Further values, after those; None without."""

    def __call__(self, graph: Graph) -> None:
        rows = () if self.rows is None else self.rows.literals()
        self.describe(graph, self.owner, (*self.literals(), *rows))

    def values(self) -> Values | None:
        """Return the values: literals, names of the owner, rows. None if a syntax would write one in another way."""
        if not _PLAIN.fullmatch(self.owner):
            return None
        texts, datatypes = list[str](), list[str]()
        for literal in self.literals():
            text, datatype = literal.value, literal.datatype.value
            if literal.language is not None or not is_replaceable(text, datatype):
                return None
            texts.append(text)
            datatypes.append(datatype)
        segments = _segments(self.owner)
        rows = None if self.rows is None else (self.rows.datatypes, min(self.rows.count, REPEATED))
        form = (self.key, len(segments), self.owner.endswith("/"), rows, *datatypes)
        texts += segments
        if self.rows is not None:
            texts += self.rows.texts
        return form, texts

    def describe_marked(self, graph: Graph, path: str, marks: Markers, rows: int) -> str:
        """Describe the resource at ``path`` with markers, and so many rows. Return its path with markers."""
        literals = self.literals()
        names = range(len(literals), len(literals) + len(_segments(self.owner)))
        owner = "/" + "/".join(map(marks.text, names))
        marked = [marks.literal(index, each.datatype) for index, each in enumerate(literals)]
        datatypes = () if self.rows is None else self.rows.datatypes * rows
        marked += [marks.literal(at, each) for at, each in enumerate(datatypes, names.stop)]
        self.describe(graph, owner + ("/" if self.owner.endswith("/") else ""), marked)
        return owner + path[len(self.owner.rstrip("/")) :]


def _segments(owner: str) -> list[str]:
    return owner.strip("/").split("/")


class MeasuredDescription:
    """The description of measured values; ``describe`` takes one measurement for each of the samplers.

    ``samplers`` observe the values in the order of the properties. ``silent`` are further ones, after those, whose
    change is no news.
    """

    __slots__ = ("_counts", "describe", "samplers", "silent")

    def __init__(
        self,
        describe: Callable[[Graph, Sequence[Measurement]], None],
        samplers: tuple[Sampler, ...],
        silent: tuple[Sampler, ...] = (),
    ) -> None:
        self.describe, self.samplers, self.silent = describe, samplers, silent
        self._counts: tuple[int, ...] = ()
        """Number of observations of each of ``samplers``."""

    def __call__(self, graph: Graph) -> None:
        self.describe(graph, self.measure())

    def measure(self) -> list[Measurement]:
        """Return the present measurements."""
        return [Measurement.from_observations(sample()) for sample in (*self.samplers, *self.silent)]

    def measurements(self, observations: Sequence[Observation]) -> list[Measurement]:
        """Return the measurements of a reading, which has the observations of all ``samplers``, in their order.

        A reading has no observations of ``silent``; they are read here.
        """
        if len(self.samplers) == 1 and not self.silent:
            return [Measurement.from_observations(observations)]
        if len(self._counts) != len(self.samplers) or sum(self._counts) != len(observations):
            self._counts = tuple(len(sample()) for sample in self.samplers)
        ends = tuple(accumulate(self._counts, initial=0))
        found = [Measurement.from_observations(observations[at:to]) for at, to in pairwise(ends)]
        return found + [Measurement.from_observations(sample()) for sample in self.silent]

    def values(self, measurements: Sequence[Measurement]) -> Values:
        """Return the values, then the times. The texts of unknown ones have no place.

        The form has the unknown values, the marks, and whether the time is known, of each measurement.
        """
        form = [
            (tuple([value != value for value in seen.values]), seen.marks, seen.wall_ns is None)
            for seen in measurements
        ]
        texts = [lexical(value) for seen in measurements for value in seen.values]  # type: ignore[arg-type]
        texts += [lexical_time(seen.wall_ns) for seen in measurements]  # type: ignore[arg-type]
        return tuple(form), texts

    def describe_marked(self, graph: Graph, measurements: Sequence[Measurement], marks: Markers) -> None:
        """Describe the measurements with markers in place of known values and times."""
        index, times = 0, sum(len(seen.values) for seen in measurements)
        marked = list[Measurement]()
        for at, seen in enumerate(measurements, times):
            values: list[Number] = []
            for value in seen.values:
                values.append(math.nan if value != value else marks.literal(index, XSD.float))
                index += 1
            time = None if seen.wall_ns is None else marks.literal(at, XSD.dateTime)
            marked.append(Measurement(tuple(values), time, seen.marks))
        self.describe(graph, marked)


@lru_cache(maxsize=64)
def _second(second: int) -> str:
    return timestamp(second * 1_000_000_000).value[:-4]


def lexical_time(wall_ns: int | None) -> str:
    """Format a time as ``timestamp`` does, with a cached part per second; None gives an empty text."""
    if wall_ns is None:
        return ""
    second, rest_ns = divmod(wall_ns, 1_000_000_000)
    return f"{_second(second)}{rest_ns // _MILLISECOND_NS:03d}Z"
