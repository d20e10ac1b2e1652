"""Thing Descriptions (W3C WoT Thing Description 1.1) of the fleet, of robots and of their parts.

They describe the same resources as the RDF, for Web of Things clients. Every form is a working request.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import Property, joint_path, link_path, robot_path
from linked_fleet_gateway.extensions.things.schema_types import with_types
from linked_fleet_gateway.faces import (
    Json,
    Measurement,
    Offer,
    RobotPart,
    form_of,
    form_of_input,
    form_of_target,
    kind_of,
    offers_at,
    part_paths,
    properties_at,
)
from linked_fleet_gateway.resources.plain_json import description_json
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import HYBRIT, LF, ROS, SOSA
from linked_fleet_state.model import Joint, Link
from linked_fleet_state.robot import Robot

TD, DIRECTORY = "application/td+json", "/things"
"""Media type of a Thing Description, and path of the directory."""
CONTEXT = "https://www.w3.org/2022/wot/td/v1.1"
DISCOVERY = "https://www.w3.org/2022/wot/discovery"
_BEYOND = {
    "minimum": "exclusiveMaximum",
    "exclusiveMinimum": "maximum",
    "maximum": "exclusiveMinimum",
    "exclusiveMaximum": "minimum",
}
"""Converts a limit into the range beyond it."""
_SUBSCRIBE = ["subscribeevent", "unsubscribeevent"]
_EVENT = LF.extended("ComponentEvent").ComponentEvent
_ID = {"type": "string", "description": "of an invocation: the id that invoking gave"}


@dataclass(frozen=True)
class Thing:
    """One Linked Robotic Thing: the fleet, a robot, or a part of it."""

    base: str
    secured: bool
    """True if callers must authenticate."""
    robot: Robot | None = None
    part: Joint | Link | RobotPart | None = None

    @property
    def path(self) -> str:
        if self.robot is None:
            return "/"
        if self.part is None:
            return robot_path(self.robot.name)
        if isinstance(self.part, Joint):
            return joint_path(self.robot.name, self.part.name)
        if not isinstance(self.part, Link):
            return self.part.path
        assert self.robot.model is not None
        return link_path(self.robot.name, self.robot.model, self.part.name)

    @property
    def id(self) -> str:
        return self.base + self.path

    def td(self, robots: Iterable[str], more: Iterable[Offer] = ()) -> Json:
        """Return the description. ``robots`` (visible ones) and ``more`` (further actions) are of the fleet only."""
        said: Json = {
            "@context": [CONTEXT, {"@language": "en"}],
            "id": self.id,
            "@type": [each.value for each in (HYBRIT.RoboticThing, *self._types())],
            "title": self._title(),
            "securityDefinitions": {"access": _scheme(self.secured)},
            "security": ["access"],
            "properties": {item.segment: self._property(item) for item in self._items()},
            "actions": {name: self._action(offer) for name, offer in self._offers(more)},
            "links": list(self._links(robots)),
        }
        if events := {each.segment: self._event(each) for each in self._items() if _EVENT in each.types}:
            said["events"] = events
        return _directory(self.base, said) if self.robot is None else said

    def _offers(self, more: Iterable[Offer]) -> Iterator[tuple[str, Offer]]:
        """Yield actions by their names; those of other things, such as missions, are named by their paths."""
        yield from ((each.definition.segment, each) for each in offers_at(self.robot, self.part))
        yield from ((each.path.strip("/"), each) for each in more)

    def _items(self) -> Sequence[Property]:
        return properties_at(self.base, self.robot, self.part)

    # -- what it is -------------------------------------------------------------------------------------------------

    def _types(self) -> Sequence[NamedNode]:
        if self.robot is None:
            return (LF.Fleet,)
        if self.part is None:
            return (LF.Robot,)
        return (*types_of(self.part), *((LF.Joint,) if isinstance(self.part, Joint) else ()))

    def _title(self) -> str:
        if self.robot is None:
            return "Linked Fleet"
        return f"{self.part.name} of {self.robot.title}" if self.part is not None else self.robot.title

    def _links(self, robots: Iterable[str]) -> Iterable[Json]:
        yield _turtle("alternate", self.id)
        yield _turtle("describedby", self.id.rstrip("/") + "/blueprint")
        if self.robot is None:
            yield from (_link("item", self.base + robot_path(name)) for name in sorted(robots))
        elif self.part is None:
            yield _link("collection", self.base + "/")
            yield from (_link("item", self.base + path) for path in part_paths(self.robot))
        else:
            yield _link("collection", self.base + robot_path(self.robot.name))

    # -- what can be done with it -----------------------------------------------------------------------------------

    def _property(self, item: Property) -> Json:
        href = f"{self.id.rstrip('/')}/{item.segment}"
        said: Json = {
            "@type": [each.value for each in (*item.types, *((SOSA.ObservableProperty,) if item.is_measured else ()))],
            "title": item.title,
            "readOnly": item.put is None,
            "observable": _is_observable(item),
        }
        if item.form is not None:
            return said | item.form.schema | {"forms": _forms(href, JSON, item)}
        if not form_of(item.shape).fields:  # an open vocabulary without known fields
            return said | {"type": "string", "forms": _forms(href, "text/turtle", item)}
        if isinstance(item.put, Offer):
            return said | _target(item.put, self.base) | {"forms": _forms(href, JSON, item)}
        iri = NamedNode(href)
        present = description_json(partial(_describe, item, iri), iri, item.shape)
        return said | _in_units(form_of(item.shape).schema, present) | {"forms": _forms(href, JSON, item)}

    def _event(self, item: Property) -> Json:
        """Return an event, which is a property too: the first message of a subscription is its last occurrence."""
        property_ = self._property(item)
        return {
            "@type": property_["@type"],
            "title": item.title,
            "data": {} if item.form is None else item.form.schema,
            "forms": [each | {"op": _SUBSCRIBE} for each in property_["forms"] if "subprotocol" in each],
        }

    def _action(self, offer: Offer) -> Json:
        href, definition = self.base + offer.path, offer.definition
        one = href + "/invocations/{id}"
        said: Json = {
            "@type": definition.iri.value,
            "title": offer.name,
            "description": definition.comment,
            "safe": False,
            "idempotent": offer.is_stop or "PUT" in offer.methods,
            "synchronous": False,
            "output": form_of(definition.produces).schema_with(offer.outcome_members),
            "uriVariables": {"id": _ID},
            "forms": [
                {
                    "href": href + "?as=json",
                    "op": "invokeaction",
                    "contentType": JSON,
                    "htv:methodName": "POST",
                    "htv:headers": [{"htv:fieldName": "Prefer", "htv:fieldValue": "return=representation"}],
                    "response": {"contentType": JSON},
                },
                {"href": one + "?as=json", "op": "queryaction", "contentType": JSON, "htv:methodName": "GET"},
                {"href": one + "/actions/cancel", "op": "cancelaction", "contentType": JSON, "htv:methodName": "POST"},
                *_stream_forms(href, offer),
            ],
        }
        return said | ({"input": form_of_input(offer, self.base).schema} if offer.takes_body else {})


def _stream_forms(href: str, offer: Offer) -> list[Json]:
    """Return the form of an action that can be opened as a stream: a WebSocket, which is both."""
    if not (protocol := offer.stream_protocol):
        return []
    url = href.replace("http", "ws", 1)
    return [{"href": url, "op": "invokeaction", "contentType": JSON, "subprotocol": protocol}]


def types_of(part: Joint | Link | RobotPart) -> Sequence[NamedNode]:
    """Return the most specific classes of a part of a robot."""
    if isinstance(part, Joint):
        return (kind_of(part).type,)
    return (ROS.Link,) if isinstance(part, Link) else part.types


def thing_description(thing: Thing, robots: Iterable[str] = (), more: Iterable[Offer] = ()) -> bytes:
    """Return the bytes of a Thing Description; ``more`` are actions of what is neither robot nor part of one."""
    return json.dumps(with_types(thing.td(robots, more)), ensure_ascii=False, allow_nan=False).encode()


def placeholder_description(id: str, secured: bool, reason: str) -> bytes:
    """Return the description of a thing without affordances, because of ``reason``."""
    said: Json = {
        "@context": [CONTEXT, {"@language": "en"}],
        "id": id,
        "title": f"{id} (not described)",
        "description": reason,
        "securityDefinitions": {"access": _scheme(secured)},
        "security": ["access"],
    }
    return json.dumps(said, ensure_ascii=False).encode()


def _scheme(secured: bool) -> Json:
    return {"scheme": "bearer", "in": "header"} if secured else {"scheme": "nosec"}


def _describe(item: Property, iri: NamedNode, graph: Any) -> None:
    item.describe(graph, iri, Measurement.from_observations(item.sample()))


def _link(rel: str, href: str) -> Json:
    """Return a link to another Thing Description, also usable without Accept (as in node-wot 0.9)."""
    return {"rel": rel, "href": href + "?as=td", "type": TD}


def _turtle(rel: str, href: str) -> Json:
    return {"rel": rel, "href": href, "type": "text/turtle"}


def _forms(href: str, media_type: str, item: Property) -> list[Json]:
    """Return forms to read, to write if possible, and to observe changes by event stream and WebSocket."""
    name = "json" if media_type == JSON else "turtle"
    # with the format, for clients that send no Accept
    read: Json = {"href": f"{href}?as={name}", "op": "readproperty", "contentType": media_type, "htv:methodName": "GET"}
    forms: list[Json] = [read]
    if item.put is not None:
        forms.append(forms[0] | {"op": "writeproperty", "htv:methodName": "PUT"})
    if _is_observable(item):
        watched: Json = {"op": ["observeproperty", "unobserveproperty"], "contentType": media_type}
        forms.append({"href": f"{href}?as={name}", **watched, "subprotocol": "sse"})
        forms.append({"href": "ws" + href.removeprefix("http"), **watched, "subprotocol": f"lf.{name}"})
    return forms


def _is_observable(item: Property) -> bool:
    return item.is_measured or item.put is not None or item.counter is not None


def _target(offer: Offer, base: str) -> Json:
    """Return the schema of a joint's target: what can be written, or else what can only be read.

    A target is unknown before the first command. A read target may be beyond the limits for writing, because these are
    rounded to six decimal places, or because a continuous joint has made whole turns.
    """
    assert offer.joint is not None
    dimension = kind_of(offer.joint).dimension
    assert dimension is not None
    written, unit = form_of_target(offer, base).schema, dimension.position.qudt.value
    value = written["properties"]["value"]
    (limits,) = (each["properties"]["value"] for each in value["oneOf"] if unit in each["properties"]["unit"]["enum"])
    beyond = [{"type": "number", _BEYOND[name]: limit} for name, limit in limits.items() if name in _BEYOND]
    read: Json = {
        "type": "object",
        "readOnly": True,
        "properties": {
            "value": {"oneOf": [{"type": "null"}, *beyond], "unit": unit},
            "unit": {"type": "string", "const": unit},
        },
        "required": ["value", "unit"],
    }
    return written | {"properties": written["properties"] | {"value": {"oneOf": [value, read]}}}


def _in_units(schema: Json, present: Mapping[str, Any]) -> Json:
    """Return the schema of a value with its constant unit (5.3.2.1, ``unit``), taken from the present value."""
    said = schema | {"properties": {**schema["properties"]}}
    members: dict[str, Json] = said["properties"]
    for name, member in members.items():
        value = present.get(name)
        if isinstance(value, dict) and "properties" in member:
            members[name] = _in_units(member, value)
        elif name != "unit" and _is_number(member) and "unit" in present:
            members[name] = member | {"unit": present["unit"]}
    if "unit" in members and "unit" in present:
        members["unit"] = {"type": "string", "const": present["unit"]}
    return said


def _is_number(schema: Json) -> bool:
    return any(each.get("type") == "number" for each in (schema, *schema.get("oneOf", ())))


def _directory(base: str, said: Json) -> Json:
    """Return the fleet as a directory of its things (W3C WoT Discovery, 7.3)."""
    index: Json = {"type": "integer", "minimum": 0}
    things: Json = {
        "title": "the Thing Descriptions of all things",
        "readOnly": True,
        "type": "array",
        "items": {"type": "object"},
        "uriVariables": {"offset": index, "limit": index | {"minimum": 1}},
        "forms": [
            {
                "href": base + DIRECTORY + "{?offset,limit}",
                "op": ["readproperty"],
                "contentType": "application/ld+json",
                "htv:methodName": "GET",
            }
        ],
    }
    one: Json = {
        "title": "the Thing Description of one thing",
        "safe": True,
        "idempotent": True,
        "uriVariables": {"id": {"@type": "ThingID", "type": "string", "format": "uri"}},
        "output": {"type": "object"},
        "forms": [
            {
                "href": base + DIRECTORY + "/{id}",
                "op": "invokeaction",
                "contentType": TD,
                "htv:methodName": "GET",
                "response": {"contentType": TD},
            }
        ],
    }
    return said | {
        "@context": [CONTEXT, DISCOVERY, {"@language": "en"}],
        "@type": ["ThingDirectory", *said["@type"]],
        "properties": said["properties"] | {"things": things},
        "actions": said["actions"] | {"retrieveThing": one},
    }
