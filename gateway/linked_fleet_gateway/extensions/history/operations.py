"""Operations on histories, for descriptions of the whole gateway."""

from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.listing import HISTORIES
from linked_fleet_gateway.extensions.history.resources import SEGMENT, measured
from linked_fleet_gateway.http.operations import described, names, parameter, reading, segment
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json
from linked_fleet_gateway.resources.paths import robot_path

_TIME: Json = {"type": "string", "format": "date-time"}
_DURATION: Json = {"type": "string", "pattern": "^PT[0-9]{1,6}S$", "examples": ["PT10S"]}
_SPAN = [
    parameter("from", "query", _TIME, "The earliest time."),
    parameter("to", "query", _TIME, "The time that is later than all."),
    parameter("last", "query", _DURATION, "So long before the newest sample, instead of from and to."),
    parameter("limit", "query", {"type": "integer", "minimum": 1, "maximum": 999_999_999}, "The most samples."),
]


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of the list, of the histories of a robot, and of those of its measured properties."""
    robots = [each for each in view.robots.values() if each.model is not None]
    of = {"robot": names(segment(robot_path(each.name)) for each in robots)}
    paths = [path.split("/")[2:] for each in robots for path in measured(each)]
    own, parts = [each for each in paths if len(each) == 1], [each for each in paths if len(each) == 2]
    whole = reading("readHistory", "The last minutes of a robot", None, {"csv": CSV, "mcap": MCAP}, _SPAN)
    found = described(HISTORIES, {}, "Histories", "The histories of all robots")
    if robots:
        found |= described(f"/{{robot}}/{SEGMENT}", of, "History", "The last minutes of a robot", whole)
    if own:
        get = reading("readOwnHistory", "The last minutes of a property of a robot", None, {"csv": CSV}, _SPAN)
        template, parameters = f"/{{robot}}/{{property}}/{SEGMENT}", of | {"property": names(each[0] for each in own)}
        found |= described(template, parameters, "OwnHistory", "History of a property of a robot", get)
    if parts:
        get = reading("readPartHistory", "The last minutes of a property of a joint or link", None, {"csv": CSV}, _SPAN)
        parameters = of | {"part": names(each[0] for each in parts), "property": names(each[1] for each in parts)}
        template = f"/{{robot}}/{{part}}/{{property}}/{SEGMENT}"
        found |= described(template, parameters, "PartHistory", "History of a property of a part", get)
    return found
