"""The extension ``openapi``: a description of the JSON interface for client generators and testers.

The OpenAPI 3.1 description has everything that one caller sees. Recent descriptions are cached.
"""

import asyncio
import json
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from typing import Any

from starlette.responses import Response

from linked_fleet_gateway.api import (
    Container,
    Content,
    Core,
    Extension,
    FleetBranch,
    Found,
    Mount,
    Request,
    RequestView,
    Resource,
    read_resource,
    time_sliced,
)
from linked_fleet_gateway.extensions.openapi.components import components
from linked_fleet_gateway.extensions.openapi.containers import container_operations
from linked_fleet_gateway.extensions.openapi.operations import (
    component_ref,
    error_responses,
    get_operation,
    path_item,
    write_operation,
)
from linked_fleet_gateway.extensions.openapi.paths import FleetPaths, capitalized
from linked_fleet_gateway.extensions.openapi.schemas import extract_alternatives, forbid_other_members, merge_null
from linked_fleet_gateway.faces import Json, parts_of
from linked_fleet_gateway.serving import Rendition, await_preconditions
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import LDP
from linked_fleet_state.answers import DescriptionAndComponents

PATH = "/openapi.json"
TYPE = "application/vnd.oai.openapi+json;version=3.1"
VERSION = "3.1.0"
_KEPT = 8
_PART = "OpenAPI"  # in faults
_METHODS = ("get", "put", "post", "patch", "delete")
_ALWAYS, _SECURED = ("400", "404", "406", "421", "429", "431", "500", "503"), ("401", "403")


class Documents:
    """Makes descriptions, one at a time, and caches the recently used ones."""

    def __init__(
        self,
        extensions: Iterable[Extension],
        containers: Callable[[], Iterable[Container[Any]]] = tuple,
    ) -> None:
        """Create the cache; ``containers`` returns those whose operations follow from their shapes."""
        self._extensions, self._containers = list(extensions), containers
        self._made: OrderedDict[bytes, Content] = OrderedDict()
        self._turn = asyncio.Lock()

    async def document(self, view: RequestView) -> Content:
        """Return the description of everything that ``view`` shows."""
        async with self._turn:
            version = await self._version(view)
            if version not in self._made:
                made = await self._make(view)
                if await self._version(view) != version:  # the fleet has changed, so it may be of both states
                    return made
                self._made[version] = made
                if len(self._made) > _KEPT:
                    self._made.popitem(last=False)
            self._made.move_to_end(version)
            return self._made[version]

    async def _version(self, view: RequestView) -> bytes:
        """Return a digest of everything that a description is made from."""
        facts = [repr((view.base, view.requires_authentication))]
        async for name, robot in time_sliced(sorted(view.robots.items())):
            said = robot.description
            known = None if said is None else (said.urdf, said.joints, said.base, said.capabilities, said.cameras)
            declared = said.components if isinstance(said, DescriptionAndComponents) else b""
            facts.append(repr((name, robot.model is None, known, robot.annotations, declared, list(parts_of(robot)))))
        for container in self._containers():
            with view.faults.guard(_PART, thing=f"members of {container.path}"):
                facts += [repr((each.path, each.record)) async for each, _ in time_sliced(container.own_actions(view))]
        return blake2b("\n".join(facts).encode(), digest_size=16).digest()

    async def _make(self, view: RequestView) -> Content:
        fleet = FleetPaths(view)
        async for robot in time_sliced(list(view.robots.values())):
            with view.faults.guard(_PART, robot.name):
                fleet.add(robot)
        paths: dict[str, Mapping[str, Any]] = {}
        # the first time they read shapes, some milliseconds each
        async for extension in time_sliced(self._extensions):
            with view.faults.guard(_PART, thing=f"operations of {extension.name}"):
                paths |= extension.operations(view)
        for container in self._containers():
            with view.faults.guard(_PART, thing=container.path):
                own = [each async for _, offers in time_sliced(container.own_actions(view)) for each in offers]
                paths |= container_operations(container)
                paths |= await asyncio.to_thread(fleet.of_members, container, own)  # a schema takes about a millisecond
        # Schemas of hundreds of joints take a second; their inputs are never modified in place, so a thread may read
        # them.
        return await asyncio.to_thread(_written, view, fleet, paths)


def _written(view: RequestView, fleet: FleetPaths, more: Mapping[str, Mapping[str, Any]]) -> Content:
    base, secured = view.base, view.requires_authentication
    paths = {**_own_paths(), **dict(fleet.paths()), **more}
    missing = {name: reason for name in view.robots if (reason := view.faults.find(_PART, name))}
    said: Json = {
        "openapi": VERSION,
        "info": {
            "title": "Linked Fleet",
            "version": "1",
            "description": "Robots as Linked Data: clients read their state and invoke their actions. This document "
            "describes the plain JSON of the gateway, and JSON-LD where a resource has no plain JSON. The unit of a "
            "number is the member beside it. Bodies may have only the members that their schema names. A body schema "
            "shared by several joints has the widest limits among them. The description of an action has the limits "
            "of its joint; values outside of them get 422.",
        },
        "servers": [{"url": base}],
        "paths": {template: _completed(item, secured, fleet.schemas) for template, item in paths.items()},
    }
    said["components"] = components(secured, fleet.schemas)
    said = merge_null(said)
    if missing:
        said["x-not-described"] = missing
    if secured:
        said["security"] = [{"bearer": []}]
    body = json.dumps(said, ensure_ascii=False, allow_nan=False).encode()
    return Content.of(body)


def _completed(item: Mapping[str, Any], secured: bool, schemas: dict[str, Json]) -> Json:
    """Return a path item with the responses that any resource may give; JSON bodies have no unnamed members.

    Successes come first, because generated clients accept the first media type of JSON that they find. ``schemas`` gets
    the schemas of bodies: generators name one that stands in the operation after it, as they do with its parameters.
    """
    common = error_responses((*_ALWAYS, *(_SECURED if secured else ("403",))))
    found = dict(item)
    for method in found.keys() & _METHODS:
        responses = common | found[method]["responses"]
        ordered = {status: responses[status] for status in sorted(responses, key=lambda each: (each[0] != "2", each))}
        operation = found[method] = found[method] | {"responses": ordered}
        if body := operation.get("requestBody"):
            name = capitalized(operation["operationId"]) + "Body"
            content = {kind: each | _closed(kind, each, name, schemas) for kind, each in body["content"].items()}
            operation["requestBody"] = body | {"content": content}
    return found


def _closed(media_type: str, body: Json, name: str, schemas: dict[str, Json]) -> Json:
    if media_type != JSON or "schema" not in body:
        return {}
    schema = forbid_other_members(body["schema"])
    if "properties" not in schema and "oneOf" not in schema:
        return {"schema": schema}
    schemas[name] = extract_alternatives(schema, name, schemas)
    return {"schema": component_ref("schemas", name)}


def _own_paths() -> dict[str, Json]:
    status: Json = {JSON: {"schema": {"type": "object", "required": ["status"]}}}
    live: Json = {"200": {"description": "Live.", "content": status}}
    described: Json = {TYPE: {"schema": {"type": "object", "required": ["openapi"]}}, JSON: {}}
    return {
        PATH: path_item({}, get=get_operation("readOpenApi", "This description", described)),
        "/health/live": path_item({}, get=write_operation("readLive", "The process serves", live)),
    }


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
        documents = Documents(core.extensions, lambda: core.live.branches.containers)
        yield Mount(branches=(branch,), readers={ApiDescription: partial(_read, documents)})


def _resolve(view: RequestView, rest: list[str]) -> Found:
    types = (LDP.Resource,)
    return (
        None if rest else Resource(PATH, "OpenAPI", None, types, remote=ApiDescription(view), publishes_changes=False)
    )


async def _read(documents: Documents, request: Request, resource: Resource, of: ApiDescription) -> Response:
    """Return the description for the caller, or 304. Raises NotAcceptable and PreconditionFailed."""
    document = await documents.document(of.view)
    content = Rendition(lambda: document.body, codings={"gzip": document.coded})
    made = resource.replace(documents=dict.fromkeys((TYPE, JSON), content))
    response = read_resource(request, made)
    await await_preconditions(request, made)
    return response
