"""Paths of actions and their invocations. Links of a new invocation lead to reading, cancelling and deleting it."""

from collections.abc import Sequence

from linked_fleet_gateway.http.operations import (
    DESCRIBED,
    ID,
    Parameters,
    header,
    parameter,
    path_item,
    reading,
    ref,
    writing,
)
from linked_fleet_gateway.rdf.serialise import JSON
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.json_form import Json

_FORMAT: Json = {"type": "string", "enum": ["json", "jsonld"], "default": "json"}
_PICKS = "The format of what is sent."
PICK = parameter("as", "query", _FORMAT, _PICKS)
_INVOCATION, _REHEARSAL = ref("schemas", "Invocation"), ref("schemas", "Rehearsal")
_APPLIED: Json = {"Preference-Applied": {"schema": {"type": "string"}}}


def action_paths(
    template: str, name: str, parameters: Parameters, offers: Sequence[Offer], body: Json | None
) -> dict[str, Json]:
    """Return the path items of an action at ``template`` and below; ``offers``: one for each thing that has it."""
    definition = offers[0].definition
    one = {**parameters, "invocation": ID}
    listed, read = f"{template}/invocations", f"{template}/invocations/{{invocation}}"
    done: Json = {"204": {"description": "The robot holds."}}
    cancel = reading(f"describeCancel{name}", "Describe the action cancel of a running invocation")
    return {
        template: path_item(
            parameters,
            get=reading(f"describe{name}", f"{definition.title}: description and shape of the body"),
            **{method.lower(): _invoke(method, name, parameters, offers[0], body) for method in offers[0].methods},
        ),
        f"{template}/produceshape": path_item(parameters, get=reading(f"shape{name}", "Shape of the result")),
        listed: path_item(parameters, get=reading(f"list{name}", "Invocations, the newest first")),
        read: path_item(
            one,
            get=reading(f"read{name}", "Read an invocation: its state, progress and result", _INVOCATION),
            delete=writing(f"delete{name}", "Stop an invocation and remove it", done),
        ),
        f"{read}/blueprint": path_item(one, get=reading(f"blueprint{name}", "Shape of an invocation")),
        f"{read}/actions/cancel": path_item(
            one, get=cancel, post=writing(f"cancel{name}", "Cancel an invocation and keep it", done)
        ),
    }


def capitalized(name: str) -> str:
    return name[0].upper() + name[1:]


def _invoke(method: str, name: str, parameters: Parameters, offer: Offer, body: Json | None) -> Json:
    # A wrong query must never prevent a stop: a request without a body accepts any format name.
    pick = parameter("as", "query", {"type": "string", "default": "json"}, _PICKS) if body is None else PICK
    fields = ["Prefer"] if body is None else ["Prefer", "IdempotencyKey", "LockToken", "IfMatch"]
    return writing(
        ("put" if method == "PUT" else "invoke") + name,
        offer.definition.title,
        invocation_responses(name, parameters),
        None if body is None else {JSON: body},
        [pick, *map(header, fields)],
        description=offer.definition.comment,
    )


def invocation_responses(name: str, parameters: Parameters) -> Json:
    """Return the responses to an invocation. A 202 contains the invocation only if the client prefers that."""
    location: Json = {"Location": ref("headers", "Location")}
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
            "content": {JSON: {"schema": _REHEARSAL}, **DESCRIBED},
        },
        "201": {
            "description": "Accepted; the invocation is sent, as preferred by return=representation.",
            "headers": location | _APPLIED,
            "content": {JSON: {"schema": _INVOCATION}, **DESCRIBED},
            "links": links,
        },
        "202": {"description": "Accepted; it goes on. Location is the invocation.", "headers": location | _APPLIED},
        "204": {"description": "Accepted. Location is the invocation.", "headers": location},
    }
