"""The extension ``audit``: each command and each change is an entry, which administrators of all robots can read."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from linked_fleet_gateway.api import Core, Extension, Mount, NavigationEntry, RequestEvent, RequestView
from linked_fleet_gateway.extensions.audit.log import AuditLog
from linked_fleet_gateway.extensions.audit.operations import operations
from linked_fleet_gateway.extensions.audit.resources import PATH, audit_branch


class AuditExtension(Extension):
    name = "audit"
    at_root = (PATH[1:],)
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    navigation = (NavigationEntry("Audit", PATH, 90, restricted=True),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.audit import page

        return (page.VIEW,)

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with AuditLog(core.redis_url, core.namespace) as log:

            def record(event: RequestEvent) -> None:
                status = "" if event.status is None else str(event.status)
                log.record(event.client, event.event, event.path, event.robot, status, event.request, event.created)

            with core.listening_to_requests(record):
                yield Mount(branches=(audit_branch(log),))
