"""The availability of a robot, in service or out of it: a setting that all gateways share, and its property."""

import logging
from collections.abc import Iterator
from functools import lru_cache

import msgspec
from msgspec import Struct
from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import Body, Graph, Property, Robot, UnprocessableContent
from linked_fleet_gateway.faces import Measurement, Setting
from linked_fleet_rdf.vocabulary import HYBRIT
from linked_fleet_rdf.vocabulary import LF as CORE

LF = CORE.extended("Availability AvailabilityShape AvailabilityInput availability inService outOfService")
AVAILABILITY = "availability"
log = logging.getLogger(__name__)


class _Record(Struct, frozen=True):
    in_service: bool
    reason: str = ""


_IN_SERVICE = _Record(in_service=True)


def out_of_service(robot: Robot) -> str | None:
    """Return why a robot is out of service; None if it is in service."""
    held = _record_of(robot)
    return None if held.in_service else held.reason


def read_availability(body: Body) -> str:
    """Return the setting that a body describes. Raises UnprocessableContent."""
    in_service = body.text(body.root, LF.inService) in ("true", "1")
    reason = body.text(body.root, LF.reason) or ""
    if not in_service and not reason.strip():
        raise UnprocessableContent("A robot that is taken out of service has a reason, such as the part that is worn.")
    return msgspec.json.encode(_Record(in_service, "" if in_service else reason)).decode()


def availability(robot: Robot) -> Property:
    """Return the property ``availability`` of a robot."""

    def describe(graph: Graph, iri: NamedNode, _: Measurement) -> None:
        reason = out_of_service(robot)
        graph.add(iri, LF.inService, Literal(reason is None))
        if reason is not None:
            graph.add(iri, LF.reason, Literal(reason))
        graph.add(iri, HYBRIT.consumes, LF.AvailabilityInput)

    setting = Setting(robot, AVAILABILITY, LF.AvailabilityInput, read_availability, heeds_lease=False)
    title = f"availability of {robot.name}"
    kinds, shape = (LF.Availability,), LF.AvailabilityShape
    return Property(AVAILABILITY, LF.availability, kinds, shape, title, describe, put=setting)


def introduction(robot: Robot) -> Iterator[tuple[NamedNode, Literal]]:
    """Yield why a robot is out of service, for the list of robots."""
    if (reason := out_of_service(robot)) is not None:
        yield LF.outOfService, Literal(reason)


def _record_of(robot: Robot) -> _Record:
    record = robot.settings.get(AVAILABILITY)
    return _IN_SERVICE if record is None else _decoded(robot.name, record)


@lru_cache(maxsize=4096)
def _decoded(robot: str, record: str) -> _Record:
    try:
        return msgspec.json.decode(record, type=_Record)
    except ValueError:
        log.error("the availability of %s cannot be read: %.200r", robot, record)  # once, because the result is kept
        return _Record(in_service=False, reason="its availability cannot be read; set it again")
