"""The extension ``audit``: each command and each change is an entry, which administrators of all robots can read."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from linked_fleet_gateway.api import Core, Extension, Mount, NavigationEntry, RequestView
from linked_fleet_gateway.extensions.audit.describing import PATH
from linked_fleet_gateway.extensions.audit.log import AuditLog
from linked_fleet_gateway.extensions.audit.operations import operations
from linked_fleet_gateway.extensions.audit.resources import CSV, Audit, audit_branch, read_audit


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
            with core.listening_to_requests(log.record):
                yield Mount(branches=(audit_branch(log),), readers={Audit: read_audit}, formats={"csv": ("CSV", CSV)})
