"""Operations of histories in OpenAPI."""

from linked_fleet_gateway.api import RequestView, robot_path
from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.listing import HISTORIES
from linked_fleet_gateway.extensions.history.past_world import SEGMENT as PAST_WORLD
from linked_fleet_gateway.extensions.history.resources import SEGMENT, measured_paths
from linked_fleet_gateway.extensions.history.values import VALUES
from linked_fleet_gateway.extensions.openapi.api import (
    Json,
    parameter,
    rdf_get_operation,
    resource_path_items,
    segment_schema,
)

_TIME: Json = {"type": "string", "format": "date-time"}
_DURATION: Json = {"type": "string", "pattern": "^PT[0-9]{1,6}S$", "examples": ["PT10S"]}
_SPACING: Json = {"type": "string", "pattern": r"^PT[0-9]{1,6}(\.[0-9]{1,9})?S$", "examples": ["PT0.5S"]}
_SPAN = [
    parameter("from", "query", _TIME, "The earliest time."),
    parameter("to", "query", _TIME, "The end of the span; samples at that time are excluded."),
    parameter("last", "query", _DURATION, "Length of the span up to the newest sample, instead of from and to."),
    parameter("at", "query", _TIME, "A single time, instead of the others: the sample that held then."),
    parameter(
        "limit", "query", {"type": "integer", "minimum": 1, "maximum": 999_999_999}, "The maximum number of samples."
    ),
]
_SPACED = [*_SPAN, parameter("every", "query", _SPACING, "The least time between two samples; others are left out.")]
_OF = parameter(
    "of", "query", {"type": "string", "examples": ["battery/charge"]}, "A property, by its path below the robot."
)


def operations(view: RequestView) -> dict[str, Json]:
    """Return the OpenAPI path items of the list of histories, and of histories of robots and measured properties."""
    robots = [each for each in view.robots.values() if each.model is not None]
    of = {"robot": segment_schema(robot_path(each.name) for each in robots)}
    paths = list[list[str]]()
    for each in robots:
        with view.faults.guard("OpenAPI", each.name, "its histories"):
            paths += [path.split("/")[2:] for path in measured_paths(each)]
    own, parts = [each for each in paths if len(each) == 1], [each for each in paths if len(each) == 2]
    whole = rdf_get_operation("readHistory", "Recent values of a robot", None, {"csv": CSV, "mcap": MCAP}, _SPACED)
    found = resource_path_items(HISTORIES, {}, "Histories", "The histories of all robots")
    if robots:
        found |= resource_path_items(f"/{{robot}}/{SEGMENT}", of, "History", "Recent values of a robot", whole)
        what = "What components of a robot said"
        values = rdf_get_operation("readComponentHistory", what, None, {"csv": CSV}, [*_SPACED, _OF])
        found |= resource_path_items(f"/{{robot}}/{SEGMENT}/{VALUES}", of, "ComponentHistory", what, values)
        what = "The world around a robot as it was"
        instant = [parameter("at", "query", _TIME, "The instant; the present without it.")]
        world = rdf_get_operation("readPastWorld", what, None, {}, instant)
        found |= resource_path_items(f"/{{robot}}/{SEGMENT}/{PAST_WORLD}", of, "PastWorld", what, world)
    if own:
        get = rdf_get_operation("readOwnHistory", "Recent values of a property of a robot", None, {"csv": CSV}, _SPACED)
        template, parameters = (
            f"/{{robot}}/{{property}}/{SEGMENT}",
            of | {"property": segment_schema(each[0] for each in own)},
        )
        found |= resource_path_items(template, parameters, "OwnHistory", "History of a property of a robot", get)
    if parts:
        get = rdf_get_operation(
            "readPartHistory", "Recent values of a property of a joint or link", None, {"csv": CSV}, _SPACED
        )
        parameters = of | {
            "part": segment_schema(each[0] for each in parts),
            "property": segment_schema(each[1] for each in parts),
        }
        template = f"/{{robot}}/{{part}}/{{property}}/{SEGMENT}"
        found |= resource_path_items(template, parameters, "PartHistory", "History of a property of a part", get)
    return found
