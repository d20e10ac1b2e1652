"""The WebSocket protocol of Foxglove (``foxglove.sdk.v1``, formerly ``foxglove.websocket.v1``): messages as bytes."""

import struct
from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct
from websockets.frames import Opcode

from linked_fleet_gateway.faces import Json, Offer, form_of_input
from linked_fleet_gateway.serving import frame

if TYPE_CHECKING:
    from foxglove import Schema

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
CAPABILITIES = ("parameters", "parametersSubscribe", "services")
JSON, JSON_SCHEMA = "json", "jsonschema"
_DATA, _CALL, _RESPONSE = 1, 2, 3
_CALL_HEADER, _DATA_HEADER = struct.Struct("<BIII"), struct.Struct("<BIQ")
_ANSWER = {"type": "object", "properties": {"status": {"type": "integer"}, "invocation": {"type": "string"}}}
_UInt32 = Annotated[int, Meta(ge=0, lt=2**32)]


class UnsupportedMessage(ValueError):  # noqa: N818
    """The message is not of this protocol, or asks for something that the gateway does not support."""


class SubscriptionRequest(Struct, rename="camel"):
    id: _UInt32
    channel_id: _UInt32


class Parameter(Struct, omit_defaults=True):
    name: str
    value: Any = None
    type: str | None = None


class Request(Struct, rename="camel"):
    """A JSON message of a client. Each ``op`` uses its own members; the others keep their defaults."""

    op: Literal[
        "subscribe", "unsubscribe", "getParameters", "setParameters",
        "subscribeParameterUpdates", "unsubscribeParameterUpdates",
    ]  # fmt: skip
    subscriptions: list[SubscriptionRequest] = []
    subscription_ids: list[_UInt32] = []
    parameter_names: list[str] = []
    parameters: list[Parameter] = []
    id: str | None = None


# A message without these would do nothing.
_REQUIRED = {
    "subscribe": "subscriptions",
    "unsubscribe": "subscriptionIds",
    "setParameters": "parameters",
    "subscribeParameterUpdates": "parameterNames",
    "unsubscribeParameterUpdates": "parameterNames",
}


@dataclass(frozen=True)
class Call:
    service: int
    id: int
    encoding: str
    content: bytes


@dataclass(frozen=True)
class Channel:
    """A channel with messages of the kind ``what``; ``robot`` is None if it belongs to no single robot.

    ``read`` returns the latest message of a part.
    """

    id: int
    topic: str
    schema: "Schema"
    robot: str | None
    what: str
    read: Callable[[], bytes] | None = None

    def advertisement(self, base: str) -> dict[str, Any]:
        schema = self.schema
        is_json = schema.encoding == JSON_SCHEMA  # whose schemas are text
        return {
            "id": self.id,
            "topic": self.topic,
            "encoding": JSON if is_json else schema.encoding,
            "schemaEncoding": schema.encoding,
            "schemaName": schema.name,
            "schema": schema.data.decode() if is_json else b64encode(schema.data).decode(),
        }


def input_schema(offer: Offer, base: str) -> Json:
    """Return the JSON Schema of requests to an action at ``base``."""
    return form_of_input(offer, base).schema if offer.takes_body else {"type": "object"}


@dataclass(frozen=True)
class Service:
    """A call invokes the offered action. ``robot``: as in Channel."""

    id: int
    offer: Offer
    robot: str | None

    @property
    def stops(self) -> bool:
        return self.offer.is_stop

    def advertisement(self, base: str) -> dict[str, Any]:
        """Return the advertisement, with the schema of requests to the action at ``base``."""
        kind = self.offer.definition.segment
        said: dict[str, Any] = {"id": self.id, "name": self.offer.path.replace("/actions/", "/"), "type": kind}
        request = input_schema(self.offer, base)
        for what, schema in (("request", request), ("response", _ANSWER)):
            text = msgspec.json.encode(schema).decode()
            form = {"encoding": JSON, "schemaName": f"{kind}_{what}", "schemaEncoding": JSON_SCHEMA, "schema": text}
            said[what] = form
        return said


def parse(message: str | bytes) -> Request | Call:
    """Parse a message of a client. Raises UnsupportedMessage."""
    try:
        return _parse_call(message) if isinstance(message, bytes) else _parse_request(message)
    except (msgspec.DecodeError, RecursionError, struct.error, UnicodeDecodeError) as error:
        raise UnsupportedMessage(f"This message is not understood: {error}"[:300]) from error


def _parse_request(message: str) -> Request:
    request = msgspec.json.decode(message, type=Request)
    needed = _REQUIRED.get(request.op)
    if needed is not None and needed not in msgspec.json.decode(message, type=dict[str, msgspec.Raw]):
        raise UnsupportedMessage(f"This message does nothing: {request.op} needs {needed}.")
    return request


def _parse_call(message: bytes) -> Call:
    op, service, call, length = _CALL_HEADER.unpack_from(message)
    content = message[_CALL_HEADER.size :]
    if op != _CALL or length > len(content):
        raise UnsupportedMessage("The only binary messages that this server accepts are complete service calls.")
    return Call(service, call, content[:length].decode(), content[length:])


def text(op: str, **said: Any) -> str:
    """Return a JSON message of the gateway."""
    return msgspec.json.encode({"op": op, **said}).decode()


def data(subscription: int, stamp_ns: int, content: bytes) -> bytes:
    """Return a message of a channel as a WebSocket frame."""
    return frame(Opcode.BINARY, _DATA_HEADER.pack(_DATA, subscription, stamp_ns) + content)


def response(call: Call, content: object) -> bytes:
    header = _CALL_HEADER.pack(_RESPONSE, call.service, call.id, len(JSON))
    return header + JSON.encode() + msgspec.json.encode(content)
