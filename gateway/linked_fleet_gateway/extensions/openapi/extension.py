"""The extension ``openapi``: a description of the gateway's JSON, for generators of clients and for testers."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

from linked_fleet_gateway.extensions.openapi.document import PATH, TYPE, Documents
from linked_fleet_gateway.extensions.openapi.http import Described, read_description, resolve
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.resources.branches import FleetBranch


class OpenApiExtension(Extension):
    name = "openapi"
    at_root = (PATH[1:],)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        branch = FleetBranch(PATH[1:], None, resolve, link=("service-desc", TYPE))
        documents = Documents(core.operations)
        yield Mount(branches=(branch,), readers={Described: partial(read_description, documents)})
