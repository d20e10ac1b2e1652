"""The extension ``audit``: each command and each change is an entry, which administrators of all robots can read."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from linked_fleet_gateway.api import Core, Extension, Mount, NavigationEntry, RequestEvent, RequestView
from linked_fleet_gateway.extensions.audit.log import AuditLog
from linked_fleet_gateway.extensions.audit.resources import PATH, audit_branch
from linked_fleet_gateway.http.operations import path_item, rdf_get_operation
from linked_fleet_gateway.resources.json_form import Json


class AuditExtension(Extension):
    name = "audit"
    at_root = (PATH[1:],)
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    navigation = (NavigationEntry("Audit", PATH, 90, restricted=True),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.audit import page

        return (page.VIEW,)

    def operations(self, view: RequestView) -> Mapping[str, Json]:
        return {PATH: path_item({}, get=rdf_get_operation("readAudit", "Commands and changes, newest first"))}

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with AuditLog(core.redis_url, core.namespace) as log:

            def record(event: RequestEvent) -> None:
                status = "" if event.status is None else str(event.status)
                log.record(event.client, event.event, event.path, event.robot, status, event.request, event.created)

            with core.listening_to_requests(record):
                yield Mount(branches=(audit_branch(log),))
