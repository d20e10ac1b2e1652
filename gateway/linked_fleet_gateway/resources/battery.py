"""The charge of a robot's battery, from its annotations (``lf:batteryCharge``); agents send no message of it."""

from decimal import Decimal, InvalidOperation
from functools import lru_cache

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.serialise import ParseError, parse
from linked_fleet_gateway.rdf.vocabulary import LF, NUMERIC

_BASE = "http://robot.invalid/r/"


def battery_charge(robot: Robot) -> Decimal | None:
    """Return the charge in percent (0 to 100) from the agent's annotations, else the clients'; None if unknown."""
    return next((found for each in robot.annotations if (found := read_charge(each)) is not None), None)


def read_charge(annotations: str) -> Decimal | None:
    """Return the charge in one layer of annotations; None if missing or not a number from 0 to 100."""
    return _read(annotations) if "batteryCharge" in annotations else None  # to parse takes long


@lru_cache(maxsize=4096)
def _read(annotations: str) -> Decimal | None:
    try:
        triples = parse(annotations.encode(), "text/turtle", _BASE)
    except ParseError:  # ``annotate`` has said so in the log
        return None
    about = (each for each in triples if each.subject == NamedNode(_BASE) and each.predicate == LF.batteryCharge)
    numbers = [number for each in about if (number := _number(each.object)) is not None]
    return next((each for each in numbers if 0 <= each <= 100), None)


def _number(term: object) -> Decimal | None:
    if not isinstance(term, Literal) or term.datatype not in NUMERIC:
        return None
    try:
        found = Decimal(term.value)
    except InvalidOperation:
        return None
    return found if found.is_finite() else None
