"""Operations on the world, its objects and zones, for descriptions of the whole gateway."""

import re

from linked_fleet_gateway.extensions.world.body import object_form
from linked_fleet_gateway.extensions.world.describe import OBJECTS, POSES
from linked_fleet_gateway.extensions.world.placement import WORLD
from linked_fleet_gateway.extensions.world.terms import LF
from linked_fleet_gateway.http.operations import (
    CHANGED,
    ID,
    created,
    described,
    header,
    parameter,
    patching,
    path_item,
    reading,
    writing,
)
from linked_fleet_gateway.rdf.serialise import JSON
from linked_fleet_gateway.rdf.units import METRE
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json
from linked_fleet_gateway.resources.paths import robot_path

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
    fields = [header("IfMatch")]
    return {
        **described(WORLD, {}, "World", "The world: robots and objects, and where they are"),
        POSES: path_item({}, get=reading("readPoseInFrame", "A pose, seen from another thing", parameters=[of, frame])),
        **described(
            OBJECTS, {}, "Objects", "Objects and zones of the world",
            post=writing("addObject", "Add an object or a zone", created("Added."), body),
        ),
        **described(
            f"{OBJECTS}/{{object}}", {"object": ID}, "Object", "An object or a zone",
            put=writing("putObject", "Replace an object", CHANGED, body, fields),
            patch=patching("patchObject", "Change an object by a SPARQL update"),
            delete=writing("deleteObject", "Take an object away", CHANGED, None, fields),
        ),
    }  # fmt: skip
