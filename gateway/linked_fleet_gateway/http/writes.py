"""Writes of resources: PUT, DELETE and PATCH, the requested interaction model, and the response to a creation.

PUT and DELETE apply to the control lease and to settings of a robot (R0.5), DELETE also to a robot that has gone. PATCH
(RFC 5789; LDP 4.2.7) takes what extensions read, such as SPARQL updates; its result is handled like PUT. A client
requests an interaction model by ``Link; rel="type"`` (LDP 5.2.3.4 and 4.2.1.4). The response to a creation has the
location and the description of the resource.
"""

import json
import re
from collections.abc import Awaitable, Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from pyoxigraph import NamedNode, Triple
from starlette.responses import Response

from linked_fleet_base import contributions
from linked_fleet_base.errors import (
    BadRequest,
    Conflict,
    InsufficientScope,
    NotAcceptable,
    NotFound,
    UnprocessableContent,
    UnsupportedMediaType,
)
from linked_fleet_gateway.actions.replicated_invocations import ReplicatedInvocations
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.http.body import body_type, convert_body, parse_body, parse_form
from linked_fleet_gateway.http.fields import field, parameters, split
from linked_fleet_gateway.http.lease_tokens import lock_token
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.preconditions import resolve_under_preconditions
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.affordance import FORM_TYPES, Control, ForgetRobot, PutSetting
from linked_fleet_gateway.resources.annotations import MAX_ANNOTATION_TRIPLES
from linked_fleet_gateway.resources.body_values import Body, Setting, validate_body
from linked_fleet_gateway.resources.invocation import describe_unchecked, unchecked_links
from linked_fleet_gateway.resources.paths import lease_path, robot_path
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_identity.rights import Right
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.validation import ground_statements, refuse_statements
from linked_fleet_rdf.vocabulary import LDP, LF
from linked_fleet_state.invocation import Priority
from linked_fleet_state.robot import Robot

if TYPE_CHECKING:
    from linked_fleet_gateway.resources.form import Form


MAX_PATCH_BYTES = 32 * 1024
Patch = Callable[[Sequence[Triple]], list[Triple]]
"""Returns the changed statements of a description. Raises UnprocessableContent."""
PatchReader = Callable[[bytes, str], Patch]
"""Reads a body, with an IRI as base. Raises BadRequest, PayloadTooLarge."""
Managed = Callable[[Sequence[Triple]], Iterable[Triple]]
"""Returns the statements of a description that clients cannot remove."""


def patch_types() -> tuple[str, ...]:
    """Return the media types of bodies of PATCH; without any there is no PATCH."""
    return tuple(contributions.present().patches)


async def read_patch(request: Request, iri: str) -> Patch:
    """Return the patch in the body, with ``iri`` as base.

    Raises BadRequest, PayloadTooLarge, Busy, UnsupportedMediaType.
    """
    try:
        media_type = body_type(request, patch_types())
    except UnsupportedMediaType as error:
        error.headers["Accept-Patch"] = ", ".join(patch_types())
        raise
    read: PatchReader = contributions.present().patches[media_type]
    return await convert_body(request, lambda content: read(content, iri), MAX_PATCH_BYTES)


def apply_patch(patch: Patch, resource: Resource, base: str, managed: Managed) -> list[Triple]:
    """Return the description after the patch. Raises UnprocessableContent if it removes managed statements."""
    graph = resource.full_graph(base)
    after = patch(graph.triples)
    left = set(after)
    refuse_statements(
        [triple for triple in managed(graph.triples) if triple not in left],
        f"{base}{resource.path}/blueprint",
        "No client takes back",
    )
    return after


async def read_change(
    request: Request, iri: str, read: Callable[[], Awaitable[list[Triple]]], managed: Managed
) -> Callable[[Resource], list[Triple] | None]:
    """Read a PUT, PATCH or DELETE of the resource at ``iri``; ``read`` reads the body of PUT.

    Return a function from the present resource to its new description; None if it is to be deleted.
    """
    if request.method == "DELETE":
        return lambda present: None
    if request.method == "PUT":
        triples = await read()
        return lambda present: triples
    patch = await read_patch(request, iri)
    return lambda present: apply_patch(patch, present, request.base, managed)


async def control_lease(request: Request, affordance: Control) -> Response:
    """PUT takes or renews the lease and returns its ``Lock-Token``; DELETE releases it with that token."""
    shared = _shared(request)
    robot, token = affordance.robot, lock_token(request)
    if request.method == "DELETE":
        if not token:
            raise BadRequest("Releasing control takes the Lock-Token that the lease came with.")
        if not await shared.release_lease(robot, token):
            raise NotFound("Nobody has control at present.")
        return Response(status_code=204)
    iri = request.base + lease_path(robot.name)
    media_type = body_type(request, FORM_TYPES)
    form = partial(_form, LF.ControlLeaseInput)
    lease = request.tree().resolve(lease_path(robot.name))
    present = ground_statements(lease.full_graph(request.base)) if isinstance(lease, Resource) else frozenset()

    def read(content: bytes) -> Body:
        return validate_body(
            parse_form(content, media_type, iri, request.base, form), LF.ControlLeaseInput, iri, present
        )

    body = await convert_body(request, read)
    holder, duration_s = body.text(body.root, LF.holder), body.number(body.root, LF.leaseDuration)
    assert holder is not None and duration_s is not None
    said = body.text(body.root, LF.priority)
    priority: Priority | None = None if said is None else "person" if said == "person" else "program"
    if priority == "person" and not request.caller.has_right(Right.PERSON, robot.name):
        raise InsufficientScope(
            "The priority of a person needs the right of one; without it, leave the priority out.", scope=Right.PERSON
        )
    _, proof = await shared.take_lease(robot, holder, duration_s, token, priority)
    request.is_renewal = proof == token
    return Response(status_code=204, headers={"lock-token": f"<{proof}>", "cache-control": "no-store"})


async def forget_robot(request: Request, affordance: ForgetRobot) -> Response:
    """DELETE of a robot that has gone for good. Raises Conflict while its agent is present."""
    path = robot_path(affordance.robot.name)
    if await resolve_under_preconditions(request, lambda: request.tree().resolve(path)) is None:
        raise NotFound("The robot is not there any more.")
    if affordance.robot.online:
        raise Conflict(
            f"{affordance.robot.name} is online. Stop its agent first; a robot can be removed once it is offline."
        )
    await _shared(request).forget_robot(affordance.robot.name, lock_token(request))
    return Response(status_code=204)


def _shared(request: Request) -> ReplicatedInvocations:
    actions: Actions = request.services.actions
    return actions.lifecycle.replicated_state


async def put_setting(request: Request, affordance: PutSetting) -> Response:
    shared = _shared(request)
    setting = affordance.setting
    change = await _change(request, setting)
    while True:
        # Evaluated in each attempt, because the value may change meanwhile, also at another gateway.
        present = await resolve_under_preconditions(request, lambda: request.tree().resolve(setting.path))
        assert present is not None  # no robot is forgotten while its settings are written
        if await _set(shared, setting, change(present), lock_token(request)):
            return await _changed(request, setting)


async def _set(shared: ReplicatedInvocations, setting: Setting, value: str | None, lease_token: str) -> bool:
    if setting.heeds_lease:
        return await shared.set_setting(setting.robot, setting.name, value, lease_token)
    return await shared.change_setting(setting.robot, setting.name, value)


async def _changed(request: Request, setting: Setting) -> Response:
    """Return the response to a change: 204, or 200 with the links of the robot that no check of motions covers."""
    robot, actions = setting.robot, request.services.actions
    if setting.decides_checks and request.method != "DELETE":
        await actions.guards.await_ready(robot, request.caller.visible_robots)
        with suppress(NotAcceptable):  # it is done already
            return _uncovered(request, robot) if robot.unchecked else Response(status_code=204)
    return Response(status_code=204)


def _uncovered(request: Request, robot: Robot) -> Response:
    path, links = robot_path(robot.name), unchecked_links(robot)

    def describe(graph: Graph) -> None:
        describe_unchecked(graph, NamedNode(request.base + path), request.base, links)

    def plain() -> bytes:
        told = [{"link": request.base + at, "mesh": each.mesh, "reason": each.reason} for at, each in links]
        return json.dumps({"unchecked": told}).encode()

    resource = Resource(path, f"Unchecked links of {robot.title}", describe, (), documents={JSON: plain})
    shown = request.services.representations.negotiate(request.effective_accept, resource, request.base)
    headers = {"content-type": shown.content_type, "cache-control": "no-store", "vary": "Accept"}
    return Response(shown.body, 200, headers)


async def _change(request: Request, setting: Setting) -> Callable[[Resource], str | None]:
    """Return the function from the present resource to the value to store; None clears the setting."""
    change = await read_change(
        request,
        request.base + setting.path,
        partial(_read_setting, request, setting),
        partial(setting.managed_statements, base=request.base),
    )

    def value(present: Resource) -> str | None:
        triples = change(present)
        if triples is None:
            return None
        return setting.validate(triples, request.base, ground_statements(present.full_graph(request.base)))

    return value


async def _read_setting(request: Request, setting: Setting) -> list[Triple]:
    iri, shape = request.base + setting.path, setting.shape
    if shape is None:
        media_type, present = body_type(request), request.tree().resolve(setting.path)
        shown = len(present.full_graph(request.base).triples) if isinstance(present, Resource) else 0
        # What is shown can be sent back, with the statements of the agent.
        limit = MAX_ANNOTATION_TRIPLES + shown
        triples = await convert_body(request, lambda body: parse_body(body, media_type, iri, request.base, limit))
        if request.has_empty_body:
            raise UnprocessableContent("Nothing would be left of the annotations; DELETE removes them.")
        return triples

    media_type, form = body_type(request, FORM_TYPES), partial(_form, shape)
    return await convert_body(request, lambda body: parse_form(body, media_type, iri, request.base, form))


def _form(shape: NamedNode) -> "Form":
    from linked_fleet_gateway.resources.json_form import form_of

    return form_of(shape)


_MODELS = (LDP.Resource.value, LDP.RDFSource.value)
# One link (RFC 8288, 3): the target, then parameters, in which quoted strings are consumed whole.
_LINK = re.compile(r'<([^<>]*+)>((?:[^",]++|"(?:[^"\\]++|\\.)*+")*+)')


def check_interaction_model(request: Request, resource: Resource) -> None:
    """Raise UnprocessableContent for an unavailable model: clients can create RDF sources but no containers.

    Actions and queries are exempt, because they do not replace the resource.
    """
    if not resource.interaction_model or resource.remote is not None or request.method not in ("POST", "PUT"):
        return
    others = [each for each in _types(field(request, "link") or "") if each.startswith(LDP.iri) and each not in _MODELS]
    if others:
        raise UnprocessableContent(
            f"What is written here is a plain {LDP.RDFSource.value}; the model <{others[0][:200]}> is not to be had."
        )


def _types(header: str) -> list[str]:
    """Return the targets of links with relation ``type`` from the resource itself; malformed links are ignored."""
    found = []
    for target, rest in _LINK.findall(header):
        said = [each for each in parameters(split(rest, ";")) if each is not None]
        relations = next((value for name, value in said if name == "rel"), "").lower().split()
        if "type" in relations and not any(name == "anchor" for name, _ in said):
            found.append(target.strip())
    return found


def created_response(request: Request, resource: Resource, accept: str | None = None) -> Response:
    """Return 201 with Location and the description (RFC 9110, 15.3.2); ``accept`` overrides the request's field."""
    accept = accept or field(request, "accept")
    representation = request.services.representations.negotiate(accept, resource, request.base)
    location = request.base + resource.path
    headers = {
        "location": location,
        "content-location": location,
        "content-type": representation.content_type,
        "etag": representation.etag,
        "cache-control": "no-store",
        "vary": "Accept",
    }
    return Response(representation.body, 201, headers)


def check_acceptable(request: Request, further: Sequence[str] = ()) -> None:
    """Raise NotAcceptable, before anything is created, if the client could not read the description.

    ``further`` are the media types that it has besides those of all resources.
    """
    offered = (*request.services.representations.media_types, *further)
    if choose(field(request, "accept"), offered) is None:
        raise NotAcceptable(f"Available here: {', '.join(offered)}.", offered=offered)
