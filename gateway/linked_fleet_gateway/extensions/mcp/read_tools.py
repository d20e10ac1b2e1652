"""The tree as resources, and the tools that read it."""

from typing import Literal

import mcp_types as types
from mcp.shared.exceptions import MCPError
from pydantic import Field

from linked_fleet_gateway.base.errors import FleetError
from linked_fleet_gateway.extensions.mcp.message_context import MessageContext
from linked_fleet_gateway.extensions.mcp.replies import content_result, is_text
from linked_fleet_gateway.extensions.mcp.tool import Progress, Target, Tool
from linked_fleet_gateway.http.internal_request import ReplyTooLong
from linked_fleet_gateway.resources.paths import robot_path

_JSONLD, _TURTLE = "application/ld+json", "text/turtle"
_ACCEPT = {
    "json": f"application/json, {_JSONLD};q=0.9, {_TURTLE};q=0.8, image/*;q=0.7, */*;q=0.1",
    "jsonld": f"{_JSONLD}, */*;q=0.1",
    "turtle": f"{_TURTLE}, */*;q=0.1",
}


class Read(Tool):
    """Read a resource of the fleet: a value, a joint, a robot, an invocation, a picture."""

    target: Target = Field(description="IRI or path of a resource, such as /")
    format: Literal["json", "jsonld", "turtle"] = Field(
        "json", description="json: plain values where there are any, else JSON-LD"
    )

    async def run(self, context: MessageContext, progress: Progress) -> types.CallToolResult:
        return content_result(await context.ask("GET", self.target, _ACCEPT[self.format]))


class Query(Tool):
    """Ask the whole fleet in SPARQL 1.1, of one instant."""

    query: str = Field(min_length=1, max_length=16_384)

    async def run(self, context: MessageContext, progress: Progress) -> types.CallToolResult:
        accept = f"application/sparql-results+json, {_TURTLE};q=0.9"
        fields = {"content-type": "application/sparql-query"}
        return content_result(await context.ask("POST", "/query", accept, fields, self.query.encode()))


def resources(context: MessageContext) -> list[types.Resource]:
    """Return the fleet and its robots; links lead to the rest."""
    named = [("fleet", "Linked Fleet", "/")]
    named += [(name, robot.title, robot_path(name)) for name, robot in sorted(context.view.robots.items())]
    return [
        types.Resource(name=name, title=title, uri=context.view.base + path, mime_type=_JSONLD)
        for name, title, path in named
    ]


def templates(context: MessageContext) -> list[types.ResourceTemplate]:
    uri, about = context.view.base + "/{+path}", "a path of the tree, such as {robot}/ or {robot}/{joint}"
    return [
        types.ResourceTemplate(name="resource", uri_template=uri, description=about, mime_type=_JSONLD),
        types.ResourceTemplate(name="turtle", uri_template=f"{uri}?as=turtle", description=about, mime_type=_TURTLE),
    ]


async def contents(context: MessageContext, uri: str) -> types.TextResourceContents:
    """Return the representation of a resource, JSON-LD unless the URI says otherwise. MCPError if it cannot be read."""
    try:
        reply = await context.ask("GET", uri, _ACCEPT["jsonld"])
    except (FleetError, ReplyTooLong) as error:
        raise MCPError(types.INVALID_PARAMS, str(error), {"uri": uri}) from error
    if reply.status != 200:
        problem = reply.problem
        raise MCPError(
            types.INVALID_PARAMS, f"{problem['title']}: {problem.get('detail', '')}", {"uri": uri, **problem}
        )
    if not is_text(kind := reply.media_type):
        raise MCPError(types.INVALID_PARAMS, f"This is {kind}; read it by HTTP.", {"uri": uri})
    return types.TextResourceContents(uri=uri, mime_type=kind, text=reply.content.decode())
