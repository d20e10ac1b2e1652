"""Units: their IRIs for output, the IRIs accepted in input, and their size in SI."""

import math
from dataclasses import dataclass

from pyoxigraph import NamedNode

from linked_fleet_gateway.rdf.vocabulary import MATHS, UNIT, VOM


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
