"""An MCP tool, and responses of the gateway as its results.

The JSON Schema of a tool is made from its arguments. A refusal contains everything needed to correct the request.
"""

import json
from base64 import b64encode
from collections.abc import Awaitable, Callable
from functools import cache
from typing import Annotated, Any, ClassVar

import mcp_types
from mcp_types import CallToolResult, ContentBlock, ImageContent, TextContent
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from linked_fleet_gateway.extensions.mcp.message_context import MessageContext
from linked_fleet_gateway.serving import Reply


def content_result(reply: Reply, note: str = "") -> CallToolResult:
    """Return the content unchanged, preceded by ``note``; a refusal becomes an error."""
    if reply.status >= 400:
        return refusal_result(reply.problem, note)
    media_type, text = reply.media_type, ""
    content: list[ContentBlock] = [TextContent(text=note)] if note else []
    if media_type.startswith("image/"):
        content.append(ImageContent(data=b64encode(reply.content).decode(), mime_type=media_type))
    elif reply.content and not is_text(media_type):
        return failure_result(f"This is {media_type} of {len(reply.content)} bytes; read it by HTTP.")
    elif text := reply.content.decode():
        content.append(TextContent(text=text))
    value = json.loads(text) if text and "json" in media_type else None
    return CallToolResult(content=content, structured_content=value if isinstance(value, dict) else None)


def is_text(media_type: str) -> bool:
    return media_type.startswith("text/") or media_type.endswith("json")


def refusal_result(problem: dict[str, Any], note: str = "") -> CallToolResult:
    """Return a tool error, as sentences and as problem details."""
    sentences = [note, f"{problem['title']} ({problem['status']}). {problem.get('detail', '')}"]
    for result in problem.get("report", ()):
        value = f" (it was {result['value']})" if "value" in result else ""
        sentences.append(f"- {result.get('path', 'the body')}: {result.get('message', 'not allowed')}{value}")
    if constraint := problem.get("constraint"):
        sentences.append(f"{constraint} states the constraint.")
    return failure_result("\n".join(each.strip() for each in sentences if each), problem)


def failure_result(text: str, structured: dict[str, Any] | None = None) -> CallToolResult:
    return CallToolResult(content=[TextContent(text=text)], structured_content=structured, is_error=True)


Progress = Callable[[float, float, str], Awaitable[None]]
"""Reports the completed share, the total and the state to the client."""
Target = Annotated[str, Field(max_length=2000)]
READS = mcp_types.ToolAnnotations(read_only_hint=True, open_world_hint=False)


class Tool(BaseModel):
    """A tool call. The class name is the tool's name, and its docstring the description for clients."""

    model_config = ConfigDict(extra="forbid")
    hints: ClassVar[mcp_types.ToolAnnotations] = READS

    @classmethod
    @cache
    def definition(cls) -> mcp_types.Tool:
        schema = cls.model_json_schema()
        name, description = cls.__name__.lower(), " ".join(schema.pop("description").split())
        return mcp_types.Tool(name=name, description=description, input_schema=schema, annotations=cls.hints)

    @classmethod
    async def call(
        cls, context: MessageContext, given: dict[str, object], progress: Progress
    ) -> mcp_types.CallToolResult:
        """Return the result, or an error that names the invalid arguments, so that the client can correct them."""
        try:
            wanted = cls.model_validate(given)
        except ValidationError as error:
            wrong = [f"- {'.'.join(map(str, each['loc']))[:200]}: {each['msg']}" for each in error.errors()[:10]]
            return failure_result("\n".join(["These arguments are invalid:", *wrong]))
        return await wanted.run(context, progress)

    async def run(self, context: MessageContext, progress: Progress) -> mcp_types.CallToolResult:
        raise NotImplementedError
