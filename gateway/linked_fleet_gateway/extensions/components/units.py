"""Units of declared numbers, and the other units in which a client may state the same quantity."""

import math
from collections.abc import Iterable

from msgspec import UNSET
from pyoxigraph import NamedNode

from linked_fleet_agent.wire.schema import Schema
from linked_fleet_rdf.graph import ANGULAR, LINEAR, UNITLESS, UNITS, Unit
from linked_fleet_rdf.vocabulary import UNIT

_QUANTITIES = (ANGULAR.accepted, ANGULAR.speeds, LINEAR.accepted, LINEAR.speeds)


def declared_unit(schema: Schema) -> Unit:
    """Return the unit of a number; a number without unit is unitless."""
    if not schema.unit:
        return UNITLESS
    iri = NamedNode(UNIT.iri + schema.unit)
    return UNITS.get(iri) or Unit(iri, iri, (iri,))


def accepted_units(schema: Schema) -> tuple[Unit, ...]:
    """Return the units that a number may be stated in, the declared one first.

    A value that must be met exactly, as an integer or one of an enumeration, has its declared unit alone.
    """
    declared = declared_unit(schema)
    same = next((units for units in _QUANTITIES if declared in units), ())
    if schema.type == "integer" or schema.enum or schema.const is not UNSET:
        same = ()
    return (declared, *(unit for unit in same if unit != declared))


def in_declared_unit(schema: Schema, value: float, stated: Iterable[object]) -> float:
    """Return a number that was stated in a unit, if any, in the declared one.

    The shape accepted the number, so that one which rounding moves past a limit is the limit.
    """
    declared = declared_unit(schema)
    unit = next((UNITS[each] for each in stated if isinstance(each, NamedNode) and each in UNITS), declared)
    if unit == declared:
        return value
    low = -math.inf if schema.minimum is None else schema.minimum
    high = math.inf if schema.maximum is None else schema.maximum
    return min(max(value * unit.si / declared.si, low), high)
