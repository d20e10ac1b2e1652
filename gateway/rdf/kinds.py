"""The one table of joint kinds and units: class, shape, predicate, path segment, unit, resolution."""

import math
from dataclasses import dataclass

from pyoxigraph import NamedNode

from gateway.fleet.model import Joint, JointKind
from gateway.rdf.vocabulary import LF, MATHS, ROS, UNIT, VOM


@dataclass(frozen=True)
class Unit:
    """A unit as it is emitted (vom:unit, qudt:unit), every IRI that is understood for it, and its size in SI."""

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

# What counts as change (ARCHITECTURE.md): a value that moved by less is the same value.
POSITION_RESOLUTION = 1e-5  # rad or m
VELOCITY_RESOLUTION = 1e-3  # rad/s or m/s
EFFORT_RESOLUTION = 1e-2  # N m or N
POSE_RESOLUTION = 1e-5  # m, and per component of a unit quaternion


@dataclass(frozen=True)
class Dimension:
    """What differs between turning and sliding."""

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
# What bodies of requests may state, by every IRI that is understood.
UNITS: dict[NamedNode, Unit] = {
    iri: unit
    for unit in (*ANGULAR.accepted, *LINEAR.accepted, *ANGULAR.speeds, *LINEAR.speeds, UNITLESS)
    for iri in unit.accepted
}


@dataclass(frozen=True)
class Kind:
    """A row of the table; ``position`` is the path segment of the joint's position."""

    type: NamedNode
    shape: NamedNode
    dimension: Dimension | None = None
    position: str | None = None
    predicate: NamedNode | None = None


KINDS: dict[JointKind, Kind] = {
    JointKind.REVOLUTE: Kind(ROS.RevoluteJoint, ROS.RevoluteJointShape, ANGULAR, "rotation", ROS.rotation),
    JointKind.CONTINUOUS: Kind(LF.ContinuousJoint, LF.ContinuousJointShape, ANGULAR, "rotation", ROS.rotation),
    JointKind.PRISMATIC: Kind(LF.PrismaticJoint, LF.PrismaticJointShape, LINEAR, "translation", LF.translation),
    JointKind.FIXED: Kind(LF.FixedJoint, LF.FixedJointShape),
    JointKind.FLOATING: Kind(LF.FloatingJoint, LF.FloatingJointShape),
    JointKind.PLANAR: Kind(LF.PlanarJoint, LF.PlanarJointShape),
}


def kind_of(joint: Joint) -> Kind:
    return KINDS[joint.kind]
