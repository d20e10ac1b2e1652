"""Operations of the timeline in OpenAPI."""

from linked_fleet_gateway.api import RequestView
from linked_fleet_gateway.extensions.openapi.api import Json, parameter, rdf_get_operation, resource_path_items
from linked_fleet_gateway.extensions.timeline.describing import PATH
from linked_fleet_gateway.extensions.timeline.resources import CSV

_TIME: Json = {"type": "string", "format": "date-time"}
_ROBOT: Json = {"type": "string", "minLength": 1, "maxLength": 256}
_WINDOW = [
    parameter("from", "query", _TIME, "The beginning of the window; without until, it is of two hours."),
    parameter("until", "query", _TIME, "The end of the window, at most 7 days after from."),
    parameter("robot", "query", _ROBOT, "The name of the robot that it is about, instead of all."),
]


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of the timeline and its blueprint."""
    get = rdf_get_operation("readTimeline", "What happened, happens and is planned", None, {"csv": CSV}, _WINDOW)
    return resource_path_items(PATH, {}, "Timeline", "What happened, happens and is planned", get)
