"""Operations of the world in OpenAPI."""

import re

from linked_fleet_gateway.api import RequestView, robot_path
from linked_fleet_gateway.extensions.openapi.api import (
    CHANGED_RESPONSE,
    ID_SCHEMA,
    Json,
    creation_responses,
    get_operation,
    header_ref,
    parameter,
    patch_operation,
    path_item,
    rdf_get_operation,
    resource_path_items,
    write_operation,
)
from linked_fleet_gateway.extensions.world.descriptions import (
    OBJECTS,
    POSES,
    object_form,
)
from linked_fleet_gateway.extensions.world.map_resources import FORM, MAP, PGM, PGM_FILE, PNG, PNG_FILE, YAML, YAML_FILE
from linked_fleet_gateway.extensions.world.placement import LF, WORLD
from linked_fleet_rdf.graph import METRE
from linked_fleet_rdf.serialise import JSON

_BALL: Json = {
    "title": "a ball",
    "position": {"x": 90, "y": 90, "z": 90, "unit": METRE.qudt.value},
    "geometry": {"form": LF.Sphere.value, "radius": {"value": 0.1, "unit": METRE.qudt.value}},
}


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of the world, of poses in it, and of its objects with all methods."""
    body: Json = {JSON: {"schema": object_form().schema, "examples": {"a ball": {"value": _BALL}}}}
    names = [view.base + path for path in (WORLD, *map(robot_path, view.robots))]
    iri: Json = {"type": "string", "format": "uri", "pattern": f"^{re.escape(view.base)}/[!-~]*$", "examples": names}
    of = parameter("of", "query", iri, "The thing whose pose it is.", required=True)
    frame = parameter("in", "query", iri, "The thing in whose frame it is: the world, if none.")
    fields = [header_ref("IfMatch")]
    return {
        **resource_path_items(WORLD, {}, "World", "The world: robots and objects, and where they are"),
        **_map_operations(fields),
        POSES: path_item(
            {}, get=rdf_get_operation("readPoseInFrame", "A pose, seen from another thing", parameters=[of, frame])
        ),
        **resource_path_items(
            OBJECTS, {}, "Objects", "Objects and zones of the world",
            post=write_operation("addObject", "Add an object or a zone", creation_responses("Added."), body),
        ),
        **resource_path_items(
            f"{OBJECTS}/{{object}}", {"object": ID_SCHEMA}, "Object", "An object or a zone",
            put=write_operation("putObject", "Replace an object", CHANGED_RESPONSE, body, fields),
            patch=patch_operation("patchObject", "Change an object by a SPARQL update"),
            delete=write_operation("deleteObject", "Remove an object", CHANGED_RESPONSE, None, fields),
        ),
    }  # fmt: skip


_FILE: Json = {"type": "string", "format": "binary"}
_MAP_FORM: Json = {
    FORM: {
        "schema": {
            "type": "object",
            "required": ["yaml", "image"],
            "properties": {
                "yaml": {**_FILE, "description": "The YAML file of map_server."},
                "image": {**_FILE, "description": "The image that it names, a PGM of 8 bits."},
                "height": {"type": "string", "description": "How high obstacles are, in metres: 2 by default."},
                "title": {"type": "string", "description": "The name of the map: that of its image by default."},
            },
        }
    }
}
_MAP_FILES = (
    ("readMapImage", PGM_FILE, PGM, "The image of the map, as it was uploaded"),
    ("readMapSettings", YAML_FILE, YAML, "The YAML file of the map, for map_server"),
    ("readMapPicture", PNG_FILE, PNG, "A picture of the map"),
)


def _map_operations(fields: list[Json]) -> dict[str, Json]:
    files = {
        f"{MAP}/{name}": path_item({}, get=get_operation(id, summary, {media_type: {"schema": _FILE}}))
        for id, name, media_type, summary in _MAP_FILES
    }
    whole = resource_path_items(
        MAP, {}, "FloorMap", "The map of the floor: which cells are occupied, free or unknown",
        put=write_operation("putFloorMap", "Replace the map of the floor", CHANGED_RESPONSE, _MAP_FORM, fields),
        delete=write_operation("deleteFloorMap", "Remove the map of the floor", CHANGED_RESPONSE, None, fields),
    )  # fmt: skip
    return {**whole, **files}
