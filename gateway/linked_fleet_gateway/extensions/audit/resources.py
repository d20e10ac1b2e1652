"""The resource ``/audit``, and how it is read."""

import asyncio
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from urllib.parse import quote, unquote

from linked_fleet_gateway.api import (
    CONTAINER,
    FleetBranch,
    Found,
    Graph,
    InSteps,
    Request,
    RequestView,
    Resource,
    Response,
    Right,
    read_resource,
)
from linked_fleet_gateway.extensions.audit.describing import PATH, Selected, audit_csv, audit_json, steps
from linked_fleet_gateway.extensions.audit.entry import AuditEntry
from linked_fleet_gateway.extensions.audit.log import AuditLog
from linked_fleet_gateway.extensions.audit.query import parse_query
from linked_fleet_gateway.serving import Rendition, check_preconditions

CSV, JSON = "text/csv", "application/json"
RIGHTS = (Right.ADMIN,)
_IN_PATHS = "/~:@!$&'()*+,;="
_AT_ONCE = 20
"""Paths that are looked up without letting others have a turn."""


@dataclass(frozen=True)
class Audit:
    """The audit; the query of the request selects a part of it."""

    log: AuditLog


def audit_branch(log: AuditLog) -> FleetBranch:
    """Return the branch of the audit."""

    def resolve(view: RequestView, rest: list[str]) -> Found:
        whole = Resource(PATH, "Audit", None, CONTAINER, remote=Audit(log), publishes_changes=False, has_form=True)
        return None if rest else whole

    return FleetBranch(PATH[1:], None, resolve, reading=RIGHTS)


async def read_audit(request: Request, resource: Resource, audit: Audit) -> Response:
    """Return the requested part of the audit, written in a thread. Raises BadRequest, Busy, RedisUnavailable."""
    query = parse_query(request.query_params.multi_items())
    found = await audit.log.find(query)
    addresses = await _addresses(request, [each for _, each in found.entries])
    selected, base = Selected(query, found, addresses), request.base

    def describe(graph: Graph) -> Iterator[None]:
        return steps(graph, base, selected)

    documents = {
        JSON: Rendition(partial(audit_json, base, selected)),
        CSV: Rendition(partial(audit_csv, selected), "audit.csv"),
    }
    part = Resource(
        PATH, "Audit", InSteps(describe), CONTAINER, documents=documents, publishes_changes=False, has_form=True
    )

    def write() -> Response:
        check_preconditions(request, part)
        return read_resource(request, part)

    return await request.services.writing_offload.run(write, len(found.entries) + 1, 0)


async def _addresses(request: Request, entries: Sequence[AuditEntry]) -> dict[str, str]:
    """Return the address of each path in entries of which there is a resource that the caller may read."""
    tree, found = request.tree(), dict[str, str]()
    said = {each.target: quote(each.target, safe=_IN_PATHS) for each in entries}
    said |= {each.result: each.result for each in entries}
    for count, (path, address) in enumerate(said.items()):
        if count % _AT_ONCE == _AT_ONCE - 1:
            await asyncio.sleep(0)
        plain, _, fragment = path.partition("#")
        if isinstance(tree.resolve(unquote(address)), Resource):
            found[path] = address
        elif fragment and isinstance(tree.resolve(plain), Resource):
            found[path] = path
        elif "/subscriptions/" in path and await _is_subscription(request, path):
            found[path] = address
    return {path: request.base + address for path, address in found.items() if path.startswith("/")}


async def _is_subscription(request: Request, path: str) -> bool:
    """Return True for the path of a subscription that lasts."""
    id = path.rpartition("/")[2]
    try:
        known = str(uuid.UUID(id)) == id
    except ValueError:
        return False
    return known and await request.services.subscriptions.get_record(id) is not None
