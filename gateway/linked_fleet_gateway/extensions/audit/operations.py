"""Operations of the audit in OpenAPI."""

from linked_fleet_gateway.api import RequestView
from linked_fleet_gateway.extensions.audit.describing import PATH
from linked_fleet_gateway.extensions.audit.query import ID_PATTERN, MOST_ENTRIES, OUTCOMES, PAGE_SIZE
from linked_fleet_gateway.extensions.audit.resources import CSV
from linked_fleet_gateway.extensions.openapi.api import Json, parameter, path_item, rdf_get_operation

_TEXT: Json = {"type": "string", "maxLength": 200}
_TIME: Json = {"type": "string", "format": "date-time"}
_ID: Json = {"type": "string", "pattern": f"^{ID_PATTERN}$"}
_PARAMETERS = [
    parameter("who", "query", _TEXT, "The name of the caller."),
    parameter("robot", "query", _TEXT, "The name of a robot."),
    parameter("resource", "query", {**_TEXT, "pattern": "^/"}, "The path of a resource, or of what contains it."),
    parameter("action", "query", _TEXT, "A method, an event, or the name of an action."),
    parameter("text", "query", _TEXT, "Words that an entry contains."),
    parameter("outcome", "query", {"type": "string", "enum": [*filter(None, OUTCOMES)]}, "How the request ended."),
    parameter("from", "query", _TIME, "The time of the first entries."),
    parameter("until", "query", _TIME, "The time before which entries are."),
    parameter("pages", "query", {"type": "string", "enum": ["on", "off"]}, "Whether with what pages do by themselves."),
    parameter("before", "query", _ID, "The id of an entry: only older ones."),
    parameter("after", "query", _ID, "The id of an entry: only newer ones."),
    parameter(
        "limit", "query", {"type": "integer", "minimum": 1, "maximum": MOST_ENTRIES, "default": PAGE_SIZE},
        "The largest number of entries.",
    ),
]  # fmt: skip


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path item of the audit."""
    schema: Json = {"type": "object", "required": ["newest", "entries"]}
    get = rdf_get_operation("readAudit", "Commands and changes, newest first", schema, {"csv": CSV}, _PARAMETERS)
    return {PATH: path_item({}, get=get)}
