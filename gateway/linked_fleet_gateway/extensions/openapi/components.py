"""The parts of a description that all operations share: problems, entity tags, preferences, security."""

from collections.abc import Mapping
from typing import Any

from linked_fleet_base.errors import PROBLEM_JSON
from linked_fleet_gateway.faces import Json, form_of
from linked_fleet_rdf.vocabulary import LF

_TEXT: Json = {"type": "string"}
_TEXTS: Json = {"type": "array", "items": _TEXT}
_OUTPUT: Json = {
    "type": "object",
    "description": "The result of an action that moves nothing, if it has one, by the local names of its predicates.",
}
_ANSWERS = {
    "304": "The representation has not changed.",
    "400": "The request is malformed.",
    "401": "The credentials are missing or wrong.",
    "403": "The caller has no right to this.",
    "404": "There is no such resource, or the caller may not see it.",
    "406": "No representation suits Accept or `as`; `offered` lists what there is.",
    "409": "The state of the robot or of the resource forbids it.",
    "412": "The resource has changed: a precondition does not hold.",
    "413": "The body is too large.",
    "415": "The media type of the body is not taken; `offered` lists those that are.",
    "421": "The fleet is not known under this authority.",
    "422": "The body breaks the shape that the resource links; `report` says where.",
    "429": "The client asks too often, or has too much that has not ended.",
    "431": "A header field has too many members.",
    "500": "The gateway failed.",
    "501": "The gateway does not offer this part of a standard.",
    "503": "The robot is offline or faulty, or the gateway is too busy.",
    "504": "The robot's agent did not answer in time.",
}
LOCK_TOKEN: Json = {
    "type": "string",
    "pattern": "^<urn:uuid:[0-9a-f-]{36}>$",
    "examples": ["<urn:uuid:00000000-0000-4000-8000-000000000000>"],
}
_FIELDS: dict[str, tuple[str, Json, str]] = {
    "IfMatch": ("If-Match", _TEXT, "Entity tags; one of them must be current."),
    "IfNoneMatch": ("If-None-Match", _TEXT, "Entity tags of representations that the client has."),
    "IdempotencyKey": (
        "Idempotency-Key",
        {"type": "string", "pattern": "^[!-~]{1,255}$"},
        "The same key, within a day, is the same request: it is carried out once.",
    ),
    "LockToken": (
        "Lock-Token",
        LOCK_TOKEN,
        "The token of the control lease of the robot, as returned with the lease.",
    ),
    "Prefer": (
        "Prefer",
        {"anyOf": [{"enum": ["return=representation", "return=minimal", "respond-async", "wait=1", "dry-run"]}, _TEXT]},
        "return=representation: the invocation is sent. respond-async: 202 at once. wait=N: answer when the motion has "
        "ended, within N s. dry-run: say what would happen, and move nothing (RFC 7240).",
    ),
}


def components(secured: bool, schemas: Mapping[str, Json]) -> Json:
    """Return the components. ``secured``: callers must authenticate; ``schemas``: those of bodies and properties."""
    found: Json = {
        "schemas": {
            "Problem": _PROBLEM,
            "JsonLd": _JSONLD,
            "Invocation": form_of(LF.InvocationShape).schema_with({"output": _OUTPUT}),
            "Rehearsal": form_of(LF.RehearsalShape).schema,
            **schemas,
        },
        "parameters": {
            name: {"name": field, "in": "header", "required": False, "schema": schema, "description": text}
            for name, (field, schema, text) in _FIELDS.items()
        },
        "headers": {
            "ETag": {"description": "The entity tag of the representation.", "required": True, "schema": _TEXT},
            "Location": {
                "description": "The URL of the created resource.",
                "required": True,
                "schema": {"type": "string", "format": "uri"},
            },
            "LockToken": {"description": "To be sent as Lock-Token.", "required": True, "schema": _TEXT},
        },
        "responses": {f"E{status}": _answer(status, text) for status, text in _ANSWERS.items()},
    }
    if secured:
        found["securitySchemes"] = {"bearer": {"type": "http", "scheme": "bearer"}}
    return found


def _answer(status: str, text: str) -> Json:
    if status == "304":
        return {"description": text}
    problem: dict[str, Any] = {PROBLEM_JSON: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    said: Json = {"description": text, "content": problem}
    if status in ("429", "503"):
        wait = {"description": "Seconds to wait before the next request.", "schema": {"type": "integer"}}
        said["headers"] = {"Retry-After": wait}
    return said


_PROBLEM: Json = {
    "type": "object",
    "description": "Problem details (RFC 9457).",
    "properties": {
        "type": {"type": "string", "format": "uri"},
        "title": _TEXT,
        "status": {"type": "integer", "minimum": 400, "maximum": 599},
        "detail": _TEXT,
        "instance": {"type": "string", "format": "uri-reference"},
        "constraint": {"type": "string", "format": "uri", "description": "The shape that the body breaks."},
        "allow": _TEXTS,
        "offered": _TEXTS,
        "unused": _TEXTS,
        "line": {"type": "integer"},
        "column": {"type": "integer"},
        "report": {
            "type": "array",
            "description": "Results of SHACL.",
            "items": {"type": "object", "additionalProperties": _TEXT},
        },
    },
    "required": ["type", "title", "status", "detail"],
}
_JSONLD: Json = {
    "type": "object",
    "description": "One node, or several in @graph (JSON-LD 1.1).",
    "properties": {"@context": {}, "@graph": {"type": "array", "items": {"type": "object"}}},
    "required": ["@context"],
}
ANNOTATIONS: Json = {
    "type": "object",
    "description": "Statements about the robot in any vocabulary; this schema names two terms of RDF Schema.",
    "properties": {
        "@context": {"const": "https://w3id.org/linked-fleet/context"},
        "@id": {"const": "./"},
        "rdfs:comment": {"type": "string", "minLength": 1, "maxLength": 1000},
        "dcterms:description": {"type": "string", "minLength": 1, "maxLength": 1000},
    },
    "required": ["@context", "@id", "rdfs:comment"],
    "additionalProperties": False,
}
