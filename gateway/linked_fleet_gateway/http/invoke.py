"""Invocation of an action: body → plan → invocation → response.

Flow "action"; R0.7, R0.8, RFC 7240, Idempotency-Key.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from hashlib import blake2b
from typing import TYPE_CHECKING

from pyoxigraph import NamedNode, Triple
from starlette.responses import Response

from linked_fleet_base.errors import (
    AgentTimeout,
    BadRequest,
    MotionRefused,
    NotAcceptable,
    UnprocessableContent,
)
from linked_fleet_gateway.actions.admission import validate_action_body
from linked_fleet_gateway.actions.execution import carry_out, empty_body, make_plan
from linked_fleet_gateway.actions.operations import Operation
from linked_fleet_gateway.actions.plan import Caller, Halt, Motion, RobotTime, robot_time
from linked_fleet_gateway.actions.rehearsals import Rehearsal
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.http.body import body_type, convert_body, parse_form
from linked_fleet_gateway.http.fields import Prefer, field, parse_prefer
from linked_fleet_gateway.http.lease_tokens import lock_token
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.preconditions import resolve_under_preconditions
from linked_fleet_gateway.http.rehearsals import rehearsal_response
from linked_fleet_gateway.http.representation import Representation
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.affordance import FORM_TYPES, EndInvocation, Invoke, PutTarget
from linked_fleet_gateway.resources.body_values import Body, input_ntriples
from linked_fleet_gateway.resources.invocation import describe_rehearsal, invocation_path
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_identity.rights import Right
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.validation import (
    Terms,
    find_root,
    ground_statements,
    reachable_statements,
    refuse_statements,
    unused_statements,
)
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_runtime.log import child_span, current_trace
from linked_fleet_state.invocations import Invocation

if TYPE_CHECKING:
    from linked_fleet_gateway.resources.form import Form

# a trajectory of seven joints at about two hundred times
MAX_BODY_BYTES = 256 * 1024
MAX_TRIPLES = 5_000
_TARGET = Terms({LF.value: Terms()})
_KEY = re.compile(r'"([\x20\x21\x23-\x5b\x5d-\x7e]{1,255})"|([!-~]{1,255})')


async def invoke(request: Request, affordance: Invoke) -> Response:
    """Invoke an action.

    The response is 204 with Location, 201 with the invocation for Prefer: return=representation, or 202 for
    respond-async or wait.
    """
    offer = affordance.offer
    _trace(offer, f"actions/{offer.definition.segment}")
    if offer.is_stop and not offer.takes_body:
        return await _halt(request, offer)
    moment, prefer = robot_time(offer.robot), _prefer(request, offer)
    admitted = _Admitted(b"", empty_body(offer, request.base), "")
    if offer.takes_body and not (offer.body_is_optional and _has_no_body(request)):
        read = partial(_read_input, offer, body_type(request, FORM_TYPES), request.base)
        slow = offer.first_body_is_slow(request.base)
        admitted = await convert_body(request, read, MAX_BODY_BYTES, is_slow=slow)
    return await _carry_out(request, offer, admitted, moment, prefer)


def _has_no_body(request: Request) -> bool:
    fields = request.arrival.fields
    return b"transfer-encoding" not in fields and not int(fields.get(b"content-length", b"0") or b"0")


async def put_target(request: Request, affordance: PutTarget) -> Response:
    """Set the target property of a joint: its ``lf:value`` is the input of the action (R0.5)."""
    offer, moment = affordance.offer, robot_time(affordance.offer.robot)
    iri = request.base + request.scope["path"]
    _trace(offer, iri.rpartition("/")[2])
    prefer = _prefer(request, offer)
    present = request.tree().resolve(request.scope["path"])
    seen = ground_statements(present.full_graph(request.base)) if isinstance(present, Resource) else frozenset[Triple]()
    read = partial(_read_target, offer, body_type(request, FORM_TYPES), iri, request.base, seen)
    slow = offer.first_body_is_slow(request.base)
    admitted = await convert_body(request, read, MAX_BODY_BYTES, is_slow=slow)
    # Evaluated again, because the target may change while the body is read.
    await resolve_under_preconditions(request, lambda: request.tree().resolve(request.scope["path"]))
    return await _carry_out(request, offer, admitted, moment, prefer)


async def end_invocation(request: Request, affordance: EndInvocation) -> Response:
    """Cancel an invocation, or stop and remove it; also by others than its creator."""
    actions: Actions = request.services.actions
    if affordance.keep_record:
        await actions.lifecycle.cancel(affordance.invocation)
    else:
        await actions.lifecycle.delete(affordance.invocation)
    return Response(status_code=204)


def _action_caller(request: Request, admitted: "_Admitted", patience_s: float | None) -> Caller:
    """Return the caller. Raises BadRequest for a malformed Idempotency-Key or Lock-Token."""
    token, key = lock_token(request), _key(request)
    return Caller(
        request.caller_name,
        token,
        key,
        _digest(request, admitted.content) if key else "",
        admitted.written,
        visible_robots=request.caller.visible_robots,
        patience_s=patience_s,
        identity=request.caller,
    )


def _trace(offer: Offer, end: str) -> None:
    """Set the route of a trace, with placeholders for names; ``end`` is one of few values."""
    if (trace := current_trace()) is None:
        return
    thing = ("/{robot}" if offer.robot else "") + ("/{joint}" if offer.joint else "")
    trace.set_route(f"{thing}/{end}")
    if offer.robot is not None:
        trace.set_attributes({"robot": offer.robot.name})


def _key(request: Request) -> str:
    if b"idempotency-key" not in request.arrival.fields:
        return ""
    said = request.headers.getlist("idempotency-key")
    match = _KEY.fullmatch(said[0].strip()) if len(said) == 1 else None
    if match is None:
        raise BadRequest("Idempotency-Key is one string of at most 255 visible characters.")
    # Two callers with the same key mean different requests.
    name, key = request.caller.name, match[1] or match[2]
    return f"{name} {key}" if name else key


def _prefer(request: Request, offer: Offer) -> Prefer:
    """Return the preferences. Raises NotAcceptable before the motion starts, never after."""
    prefer, accept = parse_prefer(field(request, "prefer")), request.effective_accept
    wants_content = prefer.dry_run or prefer.return_ == "representation"
    if wants_content and choose(accept, (JSON,)) is None:
        # Negotiated like the response, except that rehearsals and invocations are also available in plain JSON.
        _show(request, offer.path)
    return prefer


@dataclass(frozen=True)
class _Admitted:
    """A validated body: the received content, its typed form, and its form stored with the invocation."""

    content: bytes
    body: Body
    written: str


def _read_input(offer: Offer, media_type: str, base: str, content: bytes) -> _Admitted:
    """Read the input. One without statements in any syntax is none, where the action also runs without a body."""
    form, optional = partial(_input_form, offer, base), offer.body_is_optional
    skipped = optional and not content
    triples = [] if skipped else parse_form(content, media_type, base + offer.path, base, form, MAX_TRIPLES)
    if optional and not triples:
        return _Admitted(content, empty_body(offer, base), "")
    return _admitted(offer, content, triples, base)


def _read_target(
    offer: Offer, media_type: str, iri: str, base: str, seen: frozenset[Triple], content: bytes
) -> _Admitted:
    triples = parse_form(content, media_type, iri, base, partial(_target_form, offer, base), MAX_TRIPLES)
    focus = find_root(triples, NamedNode(iri))
    values = {t.object for t in triples if t.subject == focus and t.predicate == LF.value}
    if len(values) != 1:
        raise UnprocessableContent(f"The body has {len(values)} values of lf:value; one is put.", constraint=iri)
    (value,) = values
    action, about = NamedNode(base + offer.path), reachable_statements(triples, value)  # type: ignore[arg-type]
    if offer.takes_value:
        about = [*about, *(each for each in triples if each.subject == focus and each.predicate == LF.value)]
    others = set(unused_statements(triples, focus, _TARGET, seen)).difference(about)
    refuse_statements([triple for triple in triples if triple in others], f"{iri}/blueprint")
    root = focus if offer.takes_value else value
    moved = [Triple(action if t.subject == root else t.subject, t.predicate, t.object) for t in about]
    return _admitted(offer, content, moved, base)


def _admitted(offer: Offer, content: bytes, triples: Sequence[Triple], base: str) -> _Admitted:
    with child_span("guard"):
        body = validate_action_body(offer, triples, base)
    return _Admitted(content, body, input_ntriples(body))


def _input_form(offer: Offer, base: str) -> "Form":
    from linked_fleet_gateway.resources.json_form import form_of_input

    return form_of_input(offer, base)


def _target_form(offer: Offer, base: str) -> "Form":
    from linked_fleet_gateway.resources.json_form import form_of_target

    return form_of_target(offer, base)


async def _halt(request: Request, offer: Offer) -> Response:
    """Execute a stop without a body. Malformed header fields never prevent it."""
    actions: Actions = request.services.actions
    prefer = parse_prefer(field(request, "prefer"))
    plan = await make_plan(actions, offer, request.base, empty_body(offer, request.base))
    stops = request.caller.view_for(Right.STOP)
    asking = Caller(request.caller_name, stoppable_robots=stops, visible_robots=request.caller.visible_robots)
    if prefer.dry_run:
        return _rehearsal(request, offer, plan, await actions.rehearsals.of(offer, plan, asking))
    with _located(request.base):
        invocation = await carry_out(actions, offer, plan, asking)
    with suppress(NotAcceptable):
        return await _answer(request, invocation, prefer)
    return await _answer(request, invocation, replace(prefer, return_=None))


async def _carry_out(
    request: Request, offer: Offer, admitted: _Admitted, moment: RobotTime | None, prefer: Prefer
) -> Response:
    actions: Actions = request.services.actions
    asking = _action_caller(request, admitted, prefer.wait_s)
    with child_span("plan"):
        plan = await make_plan(actions, offer, request.base, admitted.body, moment)
    with _located(request.base):
        if prefer.dry_run:
            return _rehearsal(request, offer, plan, await actions.rehearsals.of(offer, plan, asking))
        invocation = await carry_out(actions, offer, plan, asking)
    return await _answer(request, invocation, prefer)


@contextmanager
def _located(base: str) -> Iterator[None]:
    """Add links to a refusal: to an invocation without answer, or to the obstacle of a motion."""
    try:
        yield
    except MotionRefused as error:
        error.locate(base)
        raise
    except AgentTimeout as error:
        if "location" in error.headers:
            error.headers["location"] = base + error.headers["location"]
        raise


async def _answer(request: Request, invocation: Invocation, prefer: Prefer) -> Response:
    status, applied = await _outcome(request.services.actions, invocation, prefer)
    location = request.base + invocation_path(invocation)
    headers = {"location": location, "cache-control": "no-store", "vary": "Accept, Prefer"}
    content = b""
    if prefer.return_ == "representation":
        applied.append("return=representation")
        shown = _show(request, invocation_path(invocation))
        content, status = shown.body, 201 if status == 204 else status
        headers |= {"content-type": shown.content_type, "content-location": location}
    if applied:
        headers["preference-applied"] = ", ".join(applied)
    return Response(content, status, headers)


def _rehearsal(request: Request, offer: Offer, plan: Motion | Halt | Operation, rehearsed: Rehearsal) -> Response:
    live: Live = request.services.live
    seen = InvocationsInView(live.invocations, request.caller.visible_robots)
    known = [each for each in map(seen.get, rehearsed.preempts) if each is not None]
    targets = plan.targets if isinstance(plan, Motion) else {}

    def describe(graph: Graph) -> None:
        describe_rehearsal(
            graph,
            request.base,
            offer.path,
            offer.robot,
            targets,
            rehearsed.facts,
            rehearsed.duration_s,
            known,
            rehearsed.findings,
            rehearsed.unchecked,
            rehearsed.limited,
            rehearsed.path,
            rehearsed.detour,
            rehearsed.closest,
            rehearsed.plan,
            rehearsed.things,
            rehearsed.describe,
        )

    return rehearsal_response(request, offer.path, f"Rehearsal of {offer.name}", describe, "dry-run")


def _show(request: Request, path: str) -> Representation:
    found = request.tree().resolve(path)
    assert isinstance(found, Resource)
    return request.services.representations.negotiate(request.effective_accept, found, request.base)


async def _outcome(actions: Actions, invocation: Invocation, prefer: Prefer) -> tuple[int, list[str]]:
    """Return status and applied preferences; 202 if the motion may still be running."""
    if prefer.wait_s is not None:
        ended = await actions.lifecycle.waiters.wait_until_or_shutdown(
            invocation, lambda one: one.state.terminal, prefer.wait_s
        )
        return 204 if ended else 202, [f"wait={prefer.wait_s:g}"]
    if prefer.respond_async:
        return 202, ["respond-async"]
    return 204, []


def _digest(request: Request, content: bytes) -> str:
    """Return the fingerprint of a request, which identifies it among others with its key: resource and body."""
    said = f"{request.scope['path']}\n{field(request, 'content-type')}\n".encode()
    return blake2b(said + content, digest_size=16).hexdigest()
