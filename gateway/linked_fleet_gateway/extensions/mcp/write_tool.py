"""The tool that writes members of containers, such as missions."""

import json
from typing import Any

from mcp_types import CallToolResult, ToolAnnotations
from pydantic import Field

from linked_fleet_gateway.extensions.mcp.message_context import MessageContext
from linked_fleet_gateway.extensions.mcp.tool import Progress, Target, Tool, content_result, refusal_result

_JSON = "application/json"


class Write(Tool):
    """Plan a mission (actions made of actions), or write another member of a container that find lists. By default it
    is only checked: actions, their bodies and your rights. keep: true keeps it, and act then runs the mission."""

    hints = ToolAnnotations(read_only_hint=False, destructive_hint=True, open_world_hint=False)
    target: Target = Field(
        "/missions", description="IRI or path of the container to add to, or of the member to replace"
    )
    body: dict[str, Any] = Field(description="valid against body_schema of the container, as returned by find")
    keep: bool = Field(False, description="keep it if it is accepted; else nothing changes")

    async def run(self, context: MessageContext, progress: Progress) -> CallToolResult:
        containers = {each.path for each in context.core.live.branches.containers}
        method = "POST" if context.path_of(self.target) in containers else "PUT"
        fields = {"content-type": _JSON, **({} if self.keep else {"prefer": "dry-run"})}
        reply = await context.ask(method, self.target, _JSON, fields, json.dumps(self.body).encode())
        if reply.status >= 400:
            return refusal_result(reply.problem, "Nothing has changed.")
        if not self.keep:
            return content_result(reply, "It would be accepted. Nothing has changed; keep: true keeps it.")
        iri = reply.headers.get("location", self.target)
        found = content_result(reply, f"It is kept: {iri}")
        found.structured_content = {"iri": iri, **(found.structured_content or {})}
        return found
