"""Rules over HTTP (desideratum D6): creation, replacement and deletion, and their operations in OpenAPI.

Operations have bodies in JSON-LD, because a rule may give its action any RDF. The error of rules is ``TooManyRules``
(429, too-many-rules).
"""

# ruff: noqa: N818  (the names say what is wrong, as those of linked_fleet_base.errors)

import time
import uuid
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

from starlette.responses import Response

from linked_fleet_base.errors import (
    BadRequest,
    FleetError,
    InsufficientScope,
    NotFound,
    PayloadTooLarge,
    PreconditionFailed,
    UnprocessableContent,
)
from linked_fleet_gateway.api import Request, Resource, Right, body_type
from linked_fleet_gateway.extensions.query.sparql_syntax import bound_iris
from linked_fleet_gateway.extensions.rules.description import ChangeRule, MakeRule, rule_path
from linked_fleet_gateway.extensions.rules.request import (
    CONTAINER,
    RuleRequest,
    check_variables,
    parse_rule,
)
from linked_fleet_gateway.extensions.rules.rule import Rule, RuleRecord
from linked_fleet_gateway.extensions.rules.rule_invocation import find_action, may_have_rules, path_in_fleet
from linked_fleet_gateway.extensions.rules.service import Rules
from linked_fleet_gateway.extensions.rules.store import Changed, FleetFull, Full
from linked_fleet_gateway.extensions.rules.template import LF
from linked_fleet_gateway.faces import Claims, Identity
from linked_fleet_gateway.serving import check_acceptable, convert_body, created_response, parse_body
from linked_fleet_rdf.sparql_tokens import MAX_QUERY_BYTES


class TooManyRules(FleetError):
    """The client, or the fleet, has too many rules (RFC 6585, 4)."""

    status, code, title = 429, "too-many-rules", "There are too many rules"


_LENGTHS = {LF.condition: MAX_QUERY_BYTES}
WORD_S = 86_400
"""Least time for which the claims of an issuer remain valid for a rule."""


async def post_rule(rules: Rules, request: Request, afforded: MakeRule) -> Response:
    """Create a rule. The response is 201 with Location and description."""
    _demand_rights(request.caller)
    media_type = body_type(request)
    check_acceptable(request)
    wanted = await _wanted(rules, request, media_type, request.base + CONTAINER)
    rule = _as_wanted(rules, request, wanted, str(uuid.uuid4()), time.time_ns())
    async with _refusals(rules):
        await rules.write(rule, None)
    path = rule_path(rule)
    shown = request.tree().resolve(path)
    if not isinstance(shown, Resource):
        raise NotFound("The rule was deleted at once.")
    return created_response(request, shown)


async def change_rule(rules: Rules, request: Request, afforded: ChangeRule) -> Response:
    """Replace a rule by PUT, or delete it. Others than the creator can only disable or enable it."""
    caller, known = request.caller, afforded.known
    own = caller.name == known.rule.creator
    if not own and not caller.has_right(Right.ADMIN, None):
        detail = "Only its creator and administrators of the fleet may change a rule."
        raise InsufficientScope(detail, scope=Right.ADMIN)
    if request.method == "DELETE":
        async with _refusals(rules):
            # Without a precondition the rule is deleted whatever its revision.
            revision = None if request.field("if-match") is None else known.revision
            if not await rules.remove(known.rule, revision):
                raise NotFound("The rule has been deleted meanwhile.")
        return Response(status_code=204)
    wanted = await _wanted(rules, request, body_type(request), request.base + rule_path(known.rule))
    while True:
        changed = _changed(rules, request, known, wanted, own)
        async with _refusals(rules):
            try:
                await rules.write(changed, known)
                return Response(status_code=204)
            except Changed:
                if request.field("if-match") is not None:
                    raise
                # The client set no precondition, and the rule was written concurrently, for example because its robot
                # was stopped.
                latest = await rules.latest(known.rule.id)
        if latest is None:
            raise NotFound("The rule has been deleted meanwhile.")
        known = latest


def _changed(rules: Rules, request: Request, known: RuleRecord, wanted: RuleRequest, own: bool) -> Rule:
    rule = known.rule
    if own:
        _demand_rights(request.caller)
        written = _as_wanted(rules, request, wanted, rule.id, rule.created_ns)
        return replace(written, client=rule.client)
    said = (rule.title, rule.condition, _iri(rule), rule.body, rule.told_apart_by, rule.interval_s, rule.holds_for_s)
    times_s = wanted.interval_s, wanted.holds_for_s
    if said != (wanted.title, wanted.condition, wanted.invokes, wanted.body, wanted.told_apart_by, *times_s):
        raise InsufficientScope(
            "Only its creator may change the content of a rule, because it has the creator's rights.", scope=Right.ADMIN
        )
    return replace(rule, enabled=wanted.enabled, reason="")


def _iri(rule: Rule) -> str:
    return rule.invokes if rule.variable else rule.base + rule.invokes


async def _wanted(rules: Rules, request: Request, media_type: str, iri: str) -> RuleRequest:
    def read(body: bytes) -> RuleRequest:
        return parse_rule(parse_body(body, media_type, iri, request.base, lengths=_LENGTHS), iri, request.base)

    wanted = await convert_body(request, read)
    try:
        selected = await rules.check(wanted.condition, request.base, request.caller_name)
        check_variables(wanted, selected, request.base)
        _check_bound(rules, request, wanted)
    except (BadRequest, PayloadTooLarge) as error:
        raise UnprocessableContent(f"lf:condition: {error.detail}", constraint=request.base + CONTAINER) from error
    return wanted


def _as_wanted(rules: Rules, request: Request, wanted: RuleRequest, id: str, created_ns: int) -> Rule:
    caller = request.caller
    invokes = wanted.invokes
    if not invokes.startswith("?"):
        invokes = _action(rules, request, invokes)
    return Rule(
        id=id,
        title=wanted.title,
        condition=wanted.condition,
        invokes=invokes,
        base=request.base,
        client=request.caller_name,
        created_ns=created_ns,
        body=wanted.body,
        told_apart_by=wanted.told_apart_by,
        interval_s=wanted.interval_s,
        holds_for_s=wanted.holds_for_s,
        enabled=wanted.enabled,
        creator=caller.name,
        claims=_word(caller),
        sees=caller.visible_robots.patterns,
    )


def _action(rules: Rules, request: Request, iri: str) -> str:
    """Return the path of an action that the caller may invoke."""
    path = path_in_fleet(iri, (request.base, *rules.bases))
    if path is None:
        raise _foreign(f"{iri[:200]!r}", request.base)
    try:
        return find_action(request.tree(), path, request.caller).path
    except UnprocessableContent as error:
        raise UnprocessableContent(error.detail, constraint=request.base + CONTAINER) from error


def _check_bound(rules: Rules, request: Request, wanted: RuleRequest) -> None:
    """Raise UnprocessableContent if the condition itself binds the action to a foreign resource."""
    if not wanted.invokes.startswith("?"):
        return
    for iri in bound_iris(wanted.condition, wanted.invokes[1:], request.base + "/query"):
        if path_in_fleet(iri, (request.base, *rules.bases)) is None:
            raise _foreign(f"lf:condition binds {wanted.invokes[:50]} to {iri[:200]!r}, which", request.base)


def _foreign(what: str, base: str) -> UnprocessableContent:
    detail = f"{what} is not an action of this fleet; here their IRIs begin with {base}/."
    return UnprocessableContent(detail, constraint=base + CONTAINER)


def _word(caller: Identity) -> Claims | None:
    """Return the claims of a caller from an issuer, valid for at least a day, because the issuer cannot be
    asked later.
    """
    if not isinstance(caller.credential, Claims):
        return None
    least_ns = time.time_ns() + WORD_S * 1_000_000_000
    return replace(caller.credential, expires_ns=max(caller.credential.expires_ns, least_ns))


def _demand_rights(caller: Identity) -> None:
    if not may_have_rules(caller):
        wanted = "to subscribe to all that you may read, and to act or stop"
        raise InsufficientScope(f"A rule requires the right {wanted}, which you do not have.", scope=Right.SUBSCRIBE)


@asynccontextmanager
async def _refusals(rules: Rules) -> AsyncIterator[None]:
    """Translate errors of the store into problems."""
    try:
        yield
    except Full as error:
        raise TooManyRules(f"You have {rules.limit} rules, as many as you may have; delete some of them.") from error
    except FleetFull as error:
        raise TooManyRules("The fleet has as many rules as it can have; some have to be deleted.") from error
    except Changed as error:
        raise PreconditionFailed("The rule has changed or been deleted meanwhile.") from error
