"""The JSON Schema of a mission, for people and programs that write one: OpenAPI, MCP, pages. Pure."""

from typing import Any

from linked_fleet_gateway.extensions.missions.describing import TYPES
from linked_fleet_gateway.extensions.missions.mission import MOST_PARAMETERS, MOST_ROUNDS, MOST_STEPS, TAGS

Json = dict[str, Any]

_NAME: Json = {"type": "string", "maxLength": 64}
_NUMBER: Json = {"type": "number"}


def _text(description: str, **more: Any) -> Json:
    return {"type": "string", "description": description, **more}


_PARAMETER: Json = {
    "type": "object",
    "required": ["name", "type"],
    "properties": {
        "name": _NAME,
        "type": {"type": "string", "enum": list(TYPES)},
        "title": {"type": "string"},
        "minimum": _NUMBER,
        "maximum": _NUMBER,
        "default": {"description": "a value of the type; without it the parameter is required"},
        "options": {"type": "array", "items": {"type": "string"}},
    },
}
_ALL = "sequence: one after the other; firstOf: until one succeeds; parallel: at the same time"
_STEP: Json = {
    "type": "object",
    "required": ["type"],
    "properties": {
        "type": {"type": "string", "enum": list(TAGS.values())},
        "name": _NAME | {"description": "unique; the variable name.member is a member of its result"},
        "title": {"type": "string", "maxLength": 200},
        "action": _text("invoke: the IRI of an action"),
        "kind": _text("invoke, instead of action: the IRI of a kind of action, at the thing of"),
        "of": {"description": 'invoke: the IRI of the thing, or {"variable": "name"}'},
        "body": {"description": 'invoke: the input of the action, in which {"variable": "name"} stands for a value'},
        "triples": _text("invoke, instead of body: N-Triples about _:body"),
        "steps": {
            "type": "array",
            "minItems": 1,
            "maxItems": MOST_STEPS,
            "items": {"description": "a step, of the same form"},
            "description": _ALL,
        },
        "anySuffices": {"type": "boolean", "description": "parallel: it succeeds with the first that does"},
        "step": {"description": "repeat: a step, of the same form"},
        "times": {"type": "integer", "minimum": 1, "maximum": MOST_ROUNDS, "description": "repeat"},
        "seconds": _NUMBER | {"minimum": 0, "description": "wait: how long"},
        "until": _text("wait: an xsd:dateTime"),
        "condition": _text("wait: a SPARQL SELECT, until it has an answer"),
        "within": _NUMBER | {"minimum": 0, "description": "wait: seconds after which the condition has failed"},
        "text": _text("confirm: what a person is asked; notify: what people are told"),
    },
}
SCHEMA: Json = {
    "type": "object",
    "required": ["title", "step"],
    "properties": {
        "title": {"type": "string", "minLength": 1, "maxLength": 200},
        "holds": {"type": "boolean", "description": "a step that fails lets the run wait for a person"},
        "parameters": {"type": "array", "maxItems": MOST_PARAMETERS, "items": _PARAMETER},
        "step": _STEP,
    },
}
"""The schema of a mission. Steps below the first one are of its form, which no schema in OpenAPI can say briefly."""
