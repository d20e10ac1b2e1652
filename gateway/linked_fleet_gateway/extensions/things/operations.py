"""Operations of Thing Descriptions in OpenAPI."""

from linked_fleet_gateway.api import RequestView
from linked_fleet_gateway.extensions.openapi.api import (
    JSONLD,
    Json,
    error_responses,
    get_operation,
    header_ref,
    parameter,
    path_item,
)
from linked_fleet_gateway.extensions.things.directory import (
    MOST,
)
from linked_fleet_gateway.extensions.things.td import DIRECTORY, TD
from linked_fleet_rdf.serialise import JSON

_THING: Json = {"type": "object", "required": ["@context", "id", "title"]}
_THINGS: Json = {"schema": {"type": "array", "items": _THING}}


def operations(view: RequestView) -> dict[str, Json]:
    """Return the operations: read the fleet's description, the directory by pages, and one thing by its id."""
    known = [header_ref("IfNoneMatch")]
    offset = parameter("offset", "query", {"type": "integer", "minimum": 0, "maximum": 999_999_999})
    limit = parameter("limit", "query", {"type": "integer", "minimum": 1, "maximum": 999_999_999}, f"At most {MOST}.")
    listed = get_operation(
        "readThings", "Thing Descriptions", {JSONLD: _THINGS, JSON: _THINGS}, [offset, limit, *known]
    )
    listed["responses"] |= error_responses(["501"])
    one: Json = {TD: {"schema": _THING}}
    id: Json = {"type": "string", "enum": [view.base + "/"]}
    return {
        "/.well-known/wot": path_item(
            {}, get=get_operation("readFleetThing", "Thing Description of the fleet", one, known)
        ),
        DIRECTORY: path_item({}, get=listed),
        f"{DIRECTORY}/{{id}}": path_item(
            {"id": id}, get=get_operation("readThing", "One Thing Description", one, known)
        ),
    }
