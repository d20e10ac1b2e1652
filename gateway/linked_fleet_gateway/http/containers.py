"""Writes of containers and their members."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from pyoxigraph import Triple
from starlette.responses import Response

from linked_fleet_gateway.base.errors import Conflict, NotFound
from linked_fleet_gateway.http.body import body_type, convert_body, parse_form
from linked_fleet_gateway.http.preconditions import resolve_under_preconditions
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.writes import check_acceptable, created_response, read_change
from linked_fleet_gateway.rdf.validation import ground_statements
from linked_fleet_gateway.resources.affordance import FORM_TYPES
from linked_fleet_gateway.resources.body_values import managed_statements, validate_body
from linked_fleet_gateway.resources.container import AddMember, ChangeMember, Container
from linked_fleet_gateway.resources.json_form import form_of
from linked_fleet_gateway.resources.resource import Resource


async def add_member(request: Request, afforded: AddMember) -> Response:
    """Create a member. The response is 201 with Location and description."""
    container = afforded.container
    check_acceptable(request)
    iri = request.base + container.path
    triples = await _read(request, container, iri)
    id = await container.records.add(container.read(validate_body(triples, container.shape, iri)))
    found = request.tree().resolve(container.member_path(id))
    if not isinstance(found, Resource):
        raise NotFound("It was deleted at once.")
    return created_response(request, found)


async def change_member(request: Request, afforded: ChangeMember) -> Response:
    """Replace, patch or delete a member. The response is 204."""
    container, id = afforded.container, afforded.id
    change, path = await _change(request, container, request.base + container.member_path(id)), request.scope["path"]
    while True:
        # Evaluated in each attempt, because the member may change meanwhile, also at another gateway.
        present = await resolve_under_preconditions(request, lambda: request.tree().resolve(path))
        if present is None:
            raise NotFound("It has been deleted meanwhile.")
        if request.method == "DELETE":
            await _end_actions(request, container, id)
        if await container.records.change(id, change(present)):
            return Response(status_code=204)


async def _end_actions(request: Request, container: Container[Any], id: str) -> None:
    """Cancel what runs of the actions of a member, because nobody could do so once it is deleted."""
    actions, live = request.services.actions, request.services.live
    for each in live.invocations.open_below(container.member_path(id)):
        with suppress(Conflict):  # it has just ended
            await actions.lifecycle.cancel(each, "what it acts on is deleted")


async def _change(request: Request, container: Container[Any], iri: str) -> Callable[[Resource], Any]:
    """Return a function from the present resource to the new record; None if the member is to be deleted."""
    own = partial(managed_statements, shape=container.shape, iri=iri)
    change = await read_change(request, iri, partial(_read, request, container, iri), own)

    def record(present: Resource) -> Any:
        triples = change(present)
        if triples is None:
            return None
        seen = ground_statements(present.full_graph(request.base))
        return container.read(validate_body(triples, container.shape, iri, seen))

    return record


async def _read(request: Request, container: Container[Any], iri: str) -> list[Triple]:
    media_type, form = body_type(request, FORM_TYPES), partial(form_of, container.shape)
    return await convert_body(request, lambda content: parse_form(content, media_type, iri, request.base, form))
