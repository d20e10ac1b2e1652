"""The reference of HTTP: tables from the OpenAPI description of a gateway with one example robot."""

import asyncio
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description
from linked_fleet_base.contributions import set_present
from linked_fleet_gateway.app.extensions import BUILT_IN, contributions_of
from linked_fleet_gateway.extensions.openapi.extension import Documents
from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_identity.rights import ALL
from linked_fleet_state.events import Appeared, Described
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations

_Json = Mapping[str, Any]
_MOVING = ("revolute", "prismatic")
_METHODS = ("get", "put", "post", "patch", "delete")
_BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<", "maxItems": "at most"}
_BODIES = """Units and other terms are IRIs; this page shows their last part. Limits are those of the example: a
revolute joint from -1 to 1 rad at 2 rad/s, a prismatic one from -1 to 1 m at 2 m/s.

"""
_NAMED_POSE = """
@prefix lf: <https://w3id.org/linked-fleet#> .
<> lf:namedPose [
    <http://purl.org/dc/terms/title> "rest" ;
    lf:target [
        lf:ofJoint <revolute> ;
        <http://vocab.arvida.de/2015/06/vom/vocab#numericalValue> 0.0 ;
        <http://vocab.arvida.de/2015/06/vom/vocab#unit> <http://qudt.org/vocab/unit/RAD>
    ]
] .
"""
_HEAD = """# HTTP

This page is generated from the OpenAPI description of a gateway with an example robot. `/openapi.json` of your gateway
describes your robots: [how to use it](openapi.md). OpenAPI covers plain JSON, and JSON-LD where a resource has no plain
JSON. All RDF resources have [more media types](subscriptions.md). Subscriptions, [queries](query.md),
[rules](rules.md), the [world](world.md), [histories](history.md) and [cameras](cameras.md) have pages of their own.

"""


def http() -> str:
    """Return the page: operations, then the schemas of their bodies and responses."""
    described = description()
    reference = _Reference(described["components"]["schemas"])
    operations = "".join(_operations(described["paths"], reference))
    return _HEAD + operations + "## Bodies and answers\n\n" + _BODIES + "".join(reference.sections())


def description() -> dict[str, Any]:
    """Return the OpenAPI description of a gateway with all built-in extensions and a robot with each kind of value."""
    set_present(contributions_of(BUILT_IN))
    fleet = Fleet()
    for event in (Appeared("example", 1), Described(_robot())):
        fleet.apply(event, 0)
    view = RequestView(
        "http://localhost:8000", fleet.robots, InvocationsInView(Invocations(), ALL), ALL, requires_authentication=True
    )
    return dict(json.loads(asyncio.run(Documents(BUILT_IN).document(view)).body))


def _robot() -> Description:
    joints = "".join(
        f'<link name="{name}_link"/><joint name="{name}" type="{name}"><parent link="base"/><child link="{name}_link"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="5" velocity="2"/></joint>'
        for name in _MOVING
    )
    return Description(
        version=WIRE_VERSION, robot="example", incarnation=1, title="An example", joints=_MOVING, base="floating",
        urdf=f'<robot name="example"><link name="base"/>{joints}</robot>', rate_hz=100, layout=layout(2, True),
        capabilities=("move", "follow", "stop"),
        annotations=_NAMED_POSE,
    )  # fmt: skip


class _Reference:
    """Schemas in words. Whole bodies and answers have a section; schemas inside them stand where they are used."""

    def __init__(self, schemas: _Json) -> None:
        self._schemas, self._linked = schemas, dict[str, None]()

    def link(self, schema: _Json) -> str:
        """Return a link to the section of a schema, which is then included in the page."""
        name = schema["$ref"].rpartition("/")[2]
        self._linked[name] = None
        return f"[{name}](#{name.lower()})"

    def sections(self) -> Iterator[str]:
        for name in sorted(self._linked):
            yield f"### {name}\n\n"
            branches = [self._schemas[name], *map(self._resolved, self._schemas[name].get("oneOf", ()))]
            yield "or\n\n".join(self._members(each) for each in branches if "properties" in each)

    def _resolved(self, schema: _Json) -> _Json:
        return dict(self._schemas[schema["$ref"].rpartition("/")[2]])

    def _members(self, schema: _Json) -> str:
        needed = schema.get("required", ())
        rows = [
            (f"`{name}`", self._words(each), "yes" if name in needed else "")
            for name, each in schema["properties"].items()
        ]
        return _table(("member", "type", "required"), rows)

    def _words(self, schema: Any) -> str:
        if not isinstance(schema, Mapping) or not schema:
            return "anything"
        if "$ref" in schema:
            return self._words(self._resolved(schema))
        for word, joined in (("oneOf", " or "), ("anyOf", " or "), ("allOf", " and ")):
            if word in schema:
                return joined.join(dict.fromkeys(map(self._words, schema[word])))
        if "const" in schema or "enum" in schema:
            return " or ".join(dict.fromkeys(map(_term, schema.get("enum", [schema.get("const")]))))
        if members := schema.get("properties"):
            return "{" + ", ".join(f"`{name}`: {self._words(each)}" for name, each in members.items()) + "}"
        types = schema.get("type", "object")
        words = [" or ".join([types] if isinstance(types, str) else types)]
        if "items" in schema:
            words += ["of", self._words(schema["items"])]
        return " ".join([*words, *(f"{sign} {schema[key]:g}" for key, sign in _BOUNDS.items() if key in schema)])


def _term(value: object) -> str:
    """Return a value of an enumeration; an IRI by its last part."""
    return f"`{re.sub(r'^https?:.*[/#]', '', value) if isinstance(value, str) else json.dumps(value)}`"


def _operations(paths: _Json, reference: _Reference) -> Iterator[str]:
    """Yield a table for each method, preceded by the responses common to its operations."""
    for method in _METHODS:
        found = {_generic(path): item[method] for path, item in reversed(list(paths.items())) if method in item}
        common = set.intersection(*(set(each["responses"]) for each in found.values()))
        refused = ", ".join(sorted(status for status in common if status >= "300"))
        yield f"## {method.upper()}\n\nEach operation may answer {refused} ([errors](errors.md)).\n\n"
        rows = [_row(path, each, common, reference) for path, each in sorted(found.items())]
        yield _table(("path", "operation", "body", "answer"), rows)


def _generic(path: str) -> str:
    """Return the path with parameters for segments that differ between paths of one operation, to list it once."""
    path = re.sub(r"^.*/actions/\w+/(?=produceshape|invocations)", "…/actions/{action}/", path)
    return re.sub(r"^/\{robot\}/(\{\w+\}/)?\w+/blueprint$", "…/{property}/blueprint", path)


def _row(path: str, operation: _Json, common: set[str], reference: _Reference) -> tuple[str, ...]:
    answers = [
        " ".join(filter(None, (status, _contents(answer, reference))))
        for status, answer in sorted(operation["responses"].items())
        if status < "300" or status not in common
    ]
    return f"`{path}`", operation["summary"], _contents(operation.get("requestBody", {}), reference), "; ".join(answers)


def _contents(message: _Json, reference: _Reference) -> str:
    """Return the distinct schemas of a body or response, or its media types if there are none."""
    content = message.get("content", {})
    schemas = [each["schema"] for each in content.values() if "$ref" in each.get("schema", {})]
    return ", ".join(dict.fromkeys(map(reference.link, schemas)) or (f"`{each}`" for each in content))


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(each.replace("|", "\\|") for each in row) + " |\n" for row in (head, *rows)]
    return "".join([lines[0], "|---" * len(head) + "|\n", *lines[1:], "\n"])
