"""Operations of the world in OpenAPI."""

import re

from linked_fleet_gateway.api import RequestView, robot_path
from linked_fleet_gateway.extensions.openapi.api import (
    CHANGED_RESPONSE,
    ID_SCHEMA,
    Json,
    creation_responses,
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
from linked_fleet_gateway.extensions.world.placement import LF, WORLD
from linked_fleet_gateway.rdf.graph import METRE
from linked_fleet_gateway.rdf.serialise import JSON

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
