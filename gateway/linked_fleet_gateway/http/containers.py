"""Writes of containers and their members."""

from collections.abc import Awaitable, Callable, Sequence, Set
from contextlib import suppress
from functools import partial
from typing import Any

from pyoxigraph import BlankNode, NamedNode, Triple
from starlette.responses import Response

from linked_fleet_base.errors import BadRequest, Conflict, InsufficientScope, NotFound
from linked_fleet_gateway.actions.plan import Caller
from linked_fleet_gateway.http.body import body_type, convert_body, parse_form
from linked_fleet_gateway.http.fields import field, parse_prefer
from linked_fleet_gateway.http.lease_tokens import lock_token
from linked_fleet_gateway.http.preconditions import resolve_under_preconditions
from linked_fleet_gateway.http.rehearsals import rehearsal_response
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.writes import check_acceptable, created_response, read_change
from linked_fleet_gateway.resources.affordance import FORM_TYPES
from linked_fleet_gateway.resources.body_values import Body, managed_statements, validate_body
from linked_fleet_gateway.resources.container import AddMember, ChangeMember, Container
from linked_fleet_gateway.resources.invocation import describe_rehearsal
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.validation import find_root, ground_statements, reachable_statements


async def add_member(request: Request, afforded: AddMember) -> Response:
    """Create a member. The response is 201 with Location and description; if it was only checked (dry-run), 204, or
    200 with a rehearsal.
    """
    container = afforded.container
    check_acceptable(request, (JSON, *container.formats))
    iri = request.base + container.path
    triples = await _read(request, container, iri)
    record = await _record(request, container, triples, iri)
    if _is_dry_run(request):
        return await _checked(request, container, record)
    id = await container.records.add(record)
    found = request.tree().resolve(container.member_path(id))
    if not isinstance(found, Resource):
        raise NotFound("It was deleted at once.")
    return created_response(request, found)


async def change_member(request: Request, afforded: ChangeMember) -> Response:
    """Replace, patch or delete a member, or only check what would replace it (dry-run). The response is 204."""
    if (dry_run := _is_dry_run(request)) and request.method == "DELETE":
        raise BadRequest("A deletion cannot be rehearsed; it is done without Prefer: dry-run. Nothing has changed.")
    container, id = afforded.container, afforded.id
    change, path = await _change(request, container, request.base + container.member_path(id)), request.scope["path"]
    while True:
        # Evaluated in each attempt, because the member may change meanwhile, also at another gateway.
        present = await resolve_under_preconditions(request, lambda: request.tree().resolve(path))
        if present is None:
            raise NotFound("It has been deleted meanwhile.")
        held = container.records.known.get(id)
        if held is not None and not container.owned(held, request.caller, request.caller_name):
            raise InsufficientScope("Only who has made it may change or delete it.", scope=container.writing[0])
        if request.method == "DELETE":
            await _end_actions(request, container, id)
        record = await change(present)
        if dry_run:
            return await _checked(request, container, record)
        if await container.records.change(id, record):
            return Response(status_code=204)


def _is_dry_run(request: Request) -> bool:
    return parse_prefer(field(request, "prefer")).dry_run


async def _checked(request: Request, container: Container[Any], record: Any) -> Response:
    """Return the response to a dry run: 204, or 200 with a rehearsal of the record if the client wants to see it."""
    prefer = parse_prefer(field(request, "prefer"))
    if container.rehearse is None or prefer.return_ != "representation":
        return Response(status_code=204, headers={"preference-applied": "dry-run"})
    identity, seen = request.caller, request.caller.visible_robots
    caller = Caller(request.caller_name, lock_token(request), visible_robots=seen, identity=identity)
    took_s, describe = await container.rehearse(record, request.tree().view, caller)

    def whole(graph: Graph) -> None:
        describe_rehearsal(graph, request.base, container.path, None, {}, {}, took_s, (), {}, describe=describe)

    return rehearsal_response(request, container.path, "Rehearsal", whole, "dry-run, return=representation")


async def _end_actions(request: Request, container: Container[Any], id: str) -> None:
    """Cancel what runs of the actions of a member, because nobody could do so once it is deleted."""
    actions, live = request.services.actions, request.services.live
    for each in live.invocations.open_below(container.member_path(id)):
        with suppress(Conflict):  # it has just ended
            await actions.lifecycle.cancel(each, "what it acts on is deleted")


async def _change(request: Request, container: Container[Any], iri: str) -> Callable[[Resource], Awaitable[Any]]:
    """Return a function from the present resource to the new record; None if the member is to be deleted."""

    def own(description: Sequence[Triple]) -> list[Triple]:
        shallow, _ = _apart(description, NamedNode(iri), container.deep)
        return managed_statements(shallow, container.shape, iri)

    change = await read_change(request, iri, partial(_read, request, container, iri), own)

    async def record(present: Resource) -> Any:
        triples = change(present)
        if triples is None:
            return None
        seen = ground_statements(present.full_graph(request.base))
        return await _record(request, container, triples, iri, seen)

    return record


async def _record(
    request: Request,
    container: Container[Any],
    triples: Sequence[Triple],
    iri: str,
    seen: frozenset[Triple] = frozenset(),
) -> Any:
    """Return the record of a body. Raises UnprocessableContent, InsufficientScope."""
    shallow, deep = _apart(triples, find_root(triples, NamedNode(iri)), container.deep)
    body = validate_body(shallow, container.shape, iri, seen)
    record = container.read(Body((*shallow, *deep), body.root) if deep else body)
    await container.check(record, request.tree(), request.caller)
    return container.signed(record, request.caller, request.caller_name)


def _apart(
    triples: Sequence[Triple], root: Node, predicates: Set[NamedNode]
) -> tuple[Sequence[Triple], Sequence[Triple]]:
    """Separate what the values of these predicates of the root lead to from all other statements."""
    values = [each.object for each in triples if each.subject == root and each.predicate in predicates]
    first = [each for each in values if isinstance(each, NamedNode | BlankNode)]
    if not first:
        return triples, ()
    deep = set(reachable_statements([each for each in triples if each.subject != root], *first))
    return [each for each in triples if each not in deep], [each for each in triples if each in deep]


async def _read(request: Request, container: Container[Any], iri: str) -> list[Triple]:
    media_type, form = body_type(request, (*FORM_TYPES, *container.formats)), partial(container.form_at, iri)
    if media_type in container.formats:
        own, _ = container.formats[media_type]
        return await convert_body(request, lambda content: own(content, iri))
    return await convert_body(request, lambda content: parse_form(content, media_type, iri, request.base, form))
