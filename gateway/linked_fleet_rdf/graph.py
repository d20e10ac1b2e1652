"""Building blocks of descriptions: ordered triples, blank nodes with stable labels, values, and units.

A unit has an IRI for output, the IRIs accepted in input, and its size in SI.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base.errors import Statement
from linked_fleet_rdf.vocabulary import LF, MATHS, QUDT, RDF, SOSA, UNIT, VOM, XSD


@dataclass(frozen=True)
class Unit:
    """A unit: its IRIs for output (vom:unit, qudt:unit), all accepted IRIs, and its size in SI."""

    vom: NamedNode
    qudt: NamedNode
    accepted: tuple[NamedNode, ...]
    si: float = 1.0


def _qudt(term: str, si: float = 1.0) -> Unit:
    iri = UNIT.terms[term]
    return Unit(iri, iri, (iri,), si)


RADIAN = Unit(MATHS.Radian, UNIT.RAD, (MATHS.Radian, VOM.Radian, UNIT.RAD))
DEGREE = Unit(MATHS.Degree, UNIT.DEG, (MATHS.Degree, VOM.Degree, UNIT.DEG), math.pi / 180)
METRE, MILLIMETRE = _qudt("M"), _qudt("MilliM", 1e-3)
KILOGRAM, UNITLESS = _qudt("KiloGM"), _qudt("UNITLESS")
NEWTON, NEWTON_METRE = _qudt("N"), _qudt("N-M")
SECOND, NANOSECOND, HERTZ = _qudt("SEC"), _qudt("NanoSEC", 1e-9), _qudt("HZ")
RADIAN_PER_SECOND, METRE_PER_SECOND = _qudt("RAD-PER-SEC"), _qudt("M-PER-SEC")
DEGREE_PER_SECOND, MILLIMETRE_PER_SECOND = _qudt("DEG-PER-SEC", math.pi / 180), _qudt("MilliM-PER-SEC", 1e-3)
KILOGRAM_SQUARE_METRE = _qudt("KiloGM-M2")
NEWTON_METRE_SECOND_PER_RADIAN, NEWTON_SECOND_PER_METRE = _qudt("N-M-SEC-PER-RAD"), _qudt("N-SEC-PER-M")


@dataclass(frozen=True)
class Dimension:
    """Units that differ between revolute and prismatic joints."""

    position: Unit
    velocity: Unit
    effort: Unit
    damping: Unit
    accepted: tuple[Unit, ...]
    speeds: tuple[Unit, ...]


ANGULAR = Dimension(
    RADIAN,
    RADIAN_PER_SECOND,
    NEWTON_METRE,
    NEWTON_METRE_SECOND_PER_RADIAN,
    (DEGREE, RADIAN),
    (DEGREE_PER_SECOND, RADIAN_PER_SECOND),
)
LINEAR = Dimension(
    METRE,
    METRE_PER_SECOND,
    NEWTON,
    NEWTON_SECOND_PER_METRE,
    (MILLIMETRE, METRE),
    (MILLIMETRE_PER_SECOND, METRE_PER_SECOND),
)
# Units accepted in request bodies, by IRI.
UNITS: dict[NamedNode, Unit] = {
    iri: unit
    for unit in (*ANGULAR.accepted, *LINEAR.accepted, *ANGULAR.speeds, *LINEAR.speeds, UNITLESS)
    for iri in unit.accepted
}


VECTOR_AXES = (MATHS.x, MATHS.y, MATHS.z)
QUATERNION_AXES = (*VECTOR_AXES, LF.w)
Node = NamedNode | BlankNode
Term = NamedNode | BlankNode | Literal
Number = float | Literal
"""A number, or the literal that is written in place of one."""


class Graph:
    """Triples in reading order. The same calls always give the same triples."""

    def __init__(self) -> None:
        self.statements: dict[Statement, None] = {}
        """The triples as tuples, in order; ``templates`` reads them faster than ``triples``."""
        self._triples: list[Triple] = []
        self._labels = 0

    @property
    def triples(self) -> list[Triple]:
        """Return the triples so far. The list grows when it is read again."""
        if len(self._triples) < len(self.statements):
            self._triples += [Triple(*each) for each in islice(self.statements, len(self._triples), None)]
        return self._triples

    def add(self, subject: Node, predicate: NamedNode, *objects: Term) -> None:
        statements = self.statements
        for value in objects:
            statements[subject, predicate, value] = None

    def extend(self, statements: Iterable[Statement]) -> None:
        self.statements.update(dict.fromkeys(statements))

    def a(self, subject: Node, *types: NamedNode) -> None:
        self.add(subject, RDF.type, *types)

    def blank(self, *types: NamedNode) -> BlankNode:
        self._labels += 1
        node = BlankNode(f"b{self._labels}")
        self.a(node, *types)
        return node

    def collection(self, items: Sequence[Term]) -> Node:
        """Add an RDF collection of ``items`` and return its head."""
        if not items:
            return RDF.nil
        cells = [self.blank() for _ in items]
        rests: list[Node] = [*cells[1:], RDF.nil]
        for cell, item, rest in zip(cells, items, rests, strict=True):
            self.add(cell, RDF.first, item)
            self.add(cell, RDF.rest, rest)
        return cells[0]

    def scalar(self, subject: Node, predicate: NamedNode, value: Number | None, unit: Unit) -> None:
        """Add a ``maths:Scalar`` as in Figure 3; the unit is added even if the value is unknown."""
        node = self.blank(MATHS.Scalar)
        self.add(subject, predicate, node)
        self.add(node, VOM.numericalValue, number(value))
        self.unit(node, unit)

    def vector(self, subject: Node, predicate: NamedNode, xyz: Sequence[Number] | None, unit: Unit | None) -> None:
        """Add a ``maths:Vector3D`` as in Figure 3, with its unit if there is one."""
        node = self.components(subject, predicate, MATHS.Vector3D, VECTOR_AXES, map(number, xyz or (None,) * 3))
        if unit is not None:
            self.unit(node, unit)

    def quaternion(self, subject: Node, predicate: NamedNode, xyzw: Sequence[Number] | None) -> None:
        self.components(subject, predicate, LF.Quaternion, QUATERNION_AXES, map(number, xyzw or (None,) * 4))

    def components(
        self, subject: Node, predicate: NamedNode, kind: NamedNode, axes: Sequence[NamedNode], terms: Iterable[Term]
    ) -> BlankNode:
        """Add a node with one term for each axis, and return it."""
        node = self.blank(kind)
        self.add(subject, predicate, node)
        for axis, term in zip(axes, terms, strict=True):
            self.add(node, axis, term)
        return node

    def unit(self, node: Node, unit: Unit) -> None:
        self.add(node, VOM.unit, unit.vom)
        self.add(node, QUDT.unit, unit.qudt)

    def result_time(self, subject: Node, wall_ns: int | Literal | None) -> None:
        self.add(subject, SOSA.resultTime, moment(wall_ns))


def number(value: Number | None) -> Term:
    """Return an xsd:float as in the figures, or ``lf:unknown`` for None and NaN. A literal stays as it is."""
    if isinstance(value, Literal):
        return value
    if value is None or math.isnan(value):
        return LF.unknown
    return Literal(lexical(value), datatype=XSD.float)


def lexical(value: float) -> str:
    """Return the lexical form of an xsd:float; -0.0 becomes 0.0."""
    return repr(float(value) + 0.0)


def integer(value: int) -> Literal:
    """Return an xsd:integer."""
    return Literal(str(value), datatype=XSD.integer)


def moment(wall_ns: int | Literal | None) -> Term:
    """Return a time, or ``lf:unknown`` for None. A literal stays as it is."""
    if isinstance(wall_ns, Literal):
        return wall_ns
    return LF.unknown if wall_ns is None else timestamp(wall_ns)


def timestamp(wall_ns: int, *, resolution_ns: int = 1_000_000) -> Literal:
    """Return an xsd:dateTime in UTC for nanoseconds since 1970, truncated to the resolution."""
    cut = wall_ns - wall_ns % resolution_ns
    stamp = datetime.fromtimestamp(cut // 1_000_000_000, UTC).replace(microsecond=cut % 1_000_000_000 // 1000)
    digits = "seconds" if resolution_ns >= 1_000_000_000 else "milliseconds"
    return Literal(stamp.isoformat(timespec=digits).replace("+00:00", "Z"), datatype=XSD.dateTime)
