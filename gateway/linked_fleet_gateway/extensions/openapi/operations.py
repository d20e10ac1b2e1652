"""Operations of OpenAPI 3.1 by which extensions describe their resources (``extensions/openapi/api.py``).

The names of components are those of ``extensions/openapi/components.py``.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from linked_fleet_gateway.faces import Json
from linked_fleet_gateway.serving import patch_types
from linked_fleet_rdf.serialise import JSON

JSONLD, TURTLE, _UPDATE = "application/ld+json", "text/turtle", "application/sparql-update"
Parameters = Mapping[str, Json]
"""Schemas of the parameters of a path, by name."""
MOST_NAMES = 256
"""Most names listed for one parameter or member; for more, only the type is given."""
CHANGED_RESPONSE: Json = {"204": {"description": "Changed."}}
ID_SCHEMA: Json = {"type": "string", "format": "uuid"}
_ALWAYS = ("400", "404", "406", "421", "429", "431", "500", "503")
_READS, _WRITES = ("304", "412"), ("409", "412", "413", "415", "422", "504")
RDF_CONTENT: Json = {JSONLD: {"schema": {"$ref": "#/components/schemas/JsonLd"}}, TURTLE: {}}
_UNCHECKED: Json = {"description": "Changed. No check of motions covers these links.", "content": RDF_CONTENT}
CHANGED_PLACEMENT_RESPONSE: Json = CHANGED_RESPONSE | {"200": _UNCHECKED}
"""Responses to a change that decides which motions are checked."""


def rdf_get_operation(
    id: str,
    summary: str,
    schema: Json | None = None,
    files: Mapping[str, str] | None = None,
    parameters: Sequence[Json] = (),
    *,
    some: bool = False,
    **more: Any,
) -> Json:
    """GET of a resource described in RDF, and in plain JSON if ``schema`` is given; ``some`` of those alike have that.

    ``files``: other media types by the values of ``?as=``.
    """
    plain = {} if schema is None else {JSON: {"schema": schema}}
    words = [*(["json"] if plain and not some else []), "jsonld", *(["json"] if plain and some else []), *(files or ())]
    picks = parameter("as", "query", {"type": "string", "enum": words, "default": words[0]}, FORMAT_DESCRIPTION)
    content = {**RDF_CONTENT, **plain} if some else {**plain, **RDF_CONTENT}
    content |= {media_type: {} for media_type in (files or {}).values()}
    return get_operation(
        id, summary, content, [picks, header_ref("IfMatch"), header_ref("IfNoneMatch"), *parameters], **more
    )


def resource_path_items(
    template: str, parameters: Parameters, id: str, title: str, get: Json | None = None, **methods: Json
) -> dict[str, Json]:
    """Return the path items of a resource and its blueprint; ``get`` if it is not read by ``rdf_get_operation``."""
    blueprint = rdf_get_operation(f"read{id}Blueprint", "The shapes of this resource")
    return {
        template: path_item(parameters, get=get or rdf_get_operation(f"read{id}", title), **methods),
        f"{template}/blueprint": path_item(parameters, get=blueprint),
    }


def get_operation(id: str, summary: str, content: Json, parameters: Sequence[Json] = (), **more: Any) -> Json:
    """Return GET of a resource with these media types."""
    read = {"description": "A representation of the resource.", "headers": {"ETag": component_ref("headers", "ETag")}}
    return {
        "operationId": id,
        "summary": summary,
        "parameters": list(parameters),
        "responses": {"200": {**read, "content": content}} | error_responses((*_ALWAYS, *_READS)),
        **more,
    }


def write_operation(
    id: str,
    summary: str,
    responses: Json,
    body: Mapping[str, Json] | None = None,
    parameters: Sequence[Json] = (),
    body_is_optional: bool = False,
    **more: Any,
) -> Json:
    """Return any other method; ``body`` are media type objects."""
    said: Json = {"operationId": id, "summary": summary, "parameters": list(parameters)}
    if body is not None:
        said["requestBody"] = {"required": not body_is_optional, "content": dict(body)}
    return said | {"responses": responses | error_responses((*_ALWAYS, *_WRITES))} | more


def patch_operation(
    id: str, summary: str, fields: Sequence[str] = ("IfMatch",), responses: Json = CHANGED_RESPONSE
) -> Json:
    """Return PATCH by a text, whose grammar no schema can express; empty if no extension reads patches."""
    body = {each: {"schema": {"type": "string", "minLength": 1}} for each in patch_types()}
    return {} if not body else write_operation(id, summary, responses, body, [header_ref(each) for each in fields])


def creation_responses(description: str) -> Json:
    """Return the response to the creation of a resource."""
    return {"201": {"description": description, "headers": {"Location": component_ref("headers", "Location")}}}


def segment_schema(paths: Iterable[str]) -> Json:
    """Return the schema of a path segment that is the last one of these paths."""
    listed = list(dict.fromkeys(map(last_segment, paths)))
    return {"type": "string", "enum": listed} if 0 < len(listed) <= MOST_NAMES else {"type": "string", "minLength": 1}


def last_segment(path: str) -> str:
    """Return the last segment of a path."""
    return path.strip("/").rpartition("/")[2]


def error_responses(statuses: Iterable[str]) -> Json:
    """Return responses with problem details, by status."""
    return {status: component_ref("responses", f"E{status}") for status in statuses}


def component_ref(kind: str, name: str) -> Json:
    return {"$ref": f"#/components/{kind}/{name}"}


def header_ref(name: str) -> Json:
    """Return one of the parameters ``IfMatch``, ``IfNoneMatch``, ``IdempotencyKey``, ``LockToken`` and ``Prefer``."""
    return component_ref("parameters", name)


def parameter(name: str, location: str, schema: Json, description: str = "", required: bool = False) -> Json:
    """Return a parameter; ``location`` is ``query``, ``header`` or ``path``."""
    said: Json = {"name": name, "in": location, "required": required, "schema": schema}
    return said | ({"description": description} if description else {})


INVOCATION, _REHEARSAL = component_ref("schemas", "Invocation"), component_ref("schemas", "Rehearsal")
_APPLIED: Json = {"Preference-Applied": {"schema": {"type": "string"}}}


def invocation_responses(name: str, parameters: Parameters, schema: Json = INVOCATION) -> Json:
    """Return the responses to an invocation, which has the ``schema``.

    A 202 contains the invocation only if the client prefers that.
    """
    location: Json = {"Location": component_ref("headers", "Location")}
    known = {each: f"$request.path.{each}" for each in parameters}
    links = {
        f"{does}Invocation": {
            "operationId": f"{does}{name}",
            "parameters": known | {"invocation": "$response.body#/id"},
        }
        for does in ("read", "cancel", "delete")
    }
    return {
        "200": {
            "description": "Rehearsed, as preferred by dry-run; nothing has moved.",
            "headers": _APPLIED,
            "content": {JSON: {"schema": _REHEARSAL}, **RDF_CONTENT},
        },
        "201": {
            "description": "Accepted; the invocation is sent, as preferred by return=representation.",
            "headers": location | _APPLIED,
            "content": {JSON: {"schema": schema}, **RDF_CONTENT},
            "links": links,
        },
        "202": {"description": "Accepted; it goes on. Location is the invocation.", "headers": location | _APPLIED},
        "204": {"description": "Accepted. Location is the invocation.", "headers": location},
    }


def path_item(parameters: Parameters, **methods: Json) -> Json:
    """Return the methods of one path that are not empty. The first values of all parameters' enums, as examples, name
    one resource.
    """
    said = [
        parameter(name, "path", schema, required=True) | ({"example": schema["enum"][0]} if "enum" in schema else {})
        for name, schema in parameters.items()
    ]
    return ({"parameters": said} if said else {}) | {name: each for name, each in methods.items() if each}


FORMAT_DESCRIPTION = "The format; without it, Accept picks one, and Turtle is sent to who says nothing."
