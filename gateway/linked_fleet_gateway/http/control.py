"""PUT and DELETE of the control lease and of settings of a robot (R0.5)."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from pyoxigraph import NamedNode, Triple
from starlette.responses import Response

from linked_fleet_gateway.actions.replicated_invocations import ReplicatedInvocations
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.base.errors import BadRequest, NotFound
from linked_fleet_gateway.http.body import body_type, parse_body, parse_form, read_as
from linked_fleet_gateway.http.invoke import lock_token, refuse_rehearsal
from linked_fleet_gateway.http.patch import apply_patch, read_patch
from linked_fleet_gateway.http.preconditions import present_under_preconditions
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.unused import shown
from linked_fleet_gateway.rdf.vocabulary import LF
from linked_fleet_gateway.resources.action_body import Body
from linked_fleet_gateway.resources.affordance import FORM_TYPES, Control, PutSetting
from linked_fleet_gateway.resources.paths import lease_path
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.setting import Setting, validated

if TYPE_CHECKING:
    from linked_fleet_gateway.resources.json_form import Form

# All of them are in every description and on every page of the robot.
MAX_ANNOTATION_TRIPLES = 256


async def control_lease(request: Request, afforded: Control) -> Response:
    """PUT takes or renews the lease and returns its ``Lock-Token``; DELETE releases it with that token."""
    shared = _shared(request)
    refuse_rehearsal(request)
    robot, token = afforded.robot, lock_token(request)
    if request.method == "DELETE":
        if not token:
            raise BadRequest("Releasing control takes the Lock-Token that the lease came with.")
        if not await shared.release(robot, token):
            raise NotFound("Nobody has control at present.")
        return Response(status_code=204)
    iri = request.base + lease_path(robot.name)
    media_type = body_type(request, FORM_TYPES)
    form = partial(_form, LF.ControlLeaseInput)
    lease = request.tree().resolve(lease_path(robot.name))
    present = shown(lease.whole(request.base)) if isinstance(lease, Resource) else frozenset()

    def read(content: bytes) -> Body:
        return validated(parse_form(content, media_type, iri, request.base, form), LF.ControlLeaseInput, iri, present)

    body = await read_as(request, read)
    holder, duration_s = body.text(body.root, LF.holder), body.number(body.root, LF.leaseDuration)
    assert holder is not None and duration_s is not None
    _, proof = await shared.take(robot, holder, duration_s, token)
    return Response(status_code=204, headers={"lock-token": f"<{proof}>", "cache-control": "no-store"})


def _shared(request: Request) -> ReplicatedInvocations:
    actions: Actions = request.services.actions
    return actions.lifecycle.replicated


async def put_setting(request: Request, afforded: PutSetting) -> Response:
    shared = _shared(request)
    refuse_rehearsal(request)
    setting = afforded.setting
    change = await _change(request, setting)
    while True:
        # Evaluated in each attempt, because the value may change meanwhile, also at another gateway.
        present = await present_under_preconditions(request, lambda: request.tree().resolve(setting.path))
        assert present is not None  # no robot is forgotten while its settings are written
        if await shared.configure(setting.robot, setting.name, change(present), lock_token(request)):
            return Response(status_code=204)


async def _change(request: Request, setting: Setting) -> Callable[[Resource], str | None]:
    """Return the function from the present resource to the value to store; None clears the setting."""
    if request.method == "DELETE":
        return lambda present: None
    if request.method == "PUT":
        triples = await _read_setting(request, setting)
        return lambda present: setting.admit(triples, request.base, shown(present.whole(request.base)))
    iri = request.base + setting.path
    update = await read_patch(request, iri)

    def patch(present: Resource) -> str:
        after = apply_patch(update, present, request.base, lambda described: setting.managed(described, request.base))
        return setting.admit(after, request.base, shown(present.whole(request.base)))

    return patch


async def _read_setting(request: Request, setting: Setting) -> list[Triple]:
    iri, shape = request.base + setting.path, setting.shape
    if shape is None:
        media_type = body_type(request)
        return await read_as(
            request, lambda body: parse_body(body, media_type, iri, request.base, MAX_ANNOTATION_TRIPLES)
        )

    media_type, form = body_type(request, FORM_TYPES), partial(_form, shape)
    return await read_as(request, lambda body: parse_form(body, media_type, iri, request.base, form))


def _form(shape: NamedNode) -> "Form":
    from linked_fleet_gateway.resources.json_form import form_of

    return form_of(shape)
