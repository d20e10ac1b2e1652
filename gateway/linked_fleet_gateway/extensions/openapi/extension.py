"""The extension ``openapi``: a description of the JSON interface for client generators and testers."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial

from starlette.responses import Response

from linked_fleet_gateway.extensions.openapi.document import PATH, TYPE, Documents
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.preconditions import await_preconditions
from linked_fleet_gateway.http.read import read
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.serialise import JSON
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.branches import FleetBranch, Found, RequestView
from linked_fleet_gateway.resources.resource import Resource


@dataclass(frozen=True)
class ApiDescription:
    """The description as the caller sees it."""

    view: RequestView


class OpenApiExtension(Extension):
    name = "openapi"
    at_root = (PATH[1:],)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        branch = FleetBranch(PATH[1:], None, _resolve, link=("service-desc", TYPE))
        documents = Documents(core.operations)
        yield Mount(branches=(branch,), readers={ApiDescription: partial(_read, documents)})


def _resolve(view: RequestView, rest: list[str]) -> Found:
    types = (LDP.Resource,)
    return None if rest else Resource(PATH, "OpenAPI", None, types, remote=ApiDescription(view), followed=False)


async def _read(documents: Documents, request: Request, resource: Resource, of: ApiDescription) -> Response:
    """Return the description for the caller, or 304. Raises NotAcceptable and PreconditionFailed."""
    body = await documents.of(of.view)
    made = replace(resource, documents={media_type: lambda: body for media_type in (TYPE, JSON)})
    response = read(request, made)
    await await_preconditions(request, made)
    return response
