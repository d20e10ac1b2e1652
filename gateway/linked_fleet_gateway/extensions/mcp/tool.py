"""An MCP tool: its arguments, from which its JSON Schema is made, and its execution."""

from collections.abc import Awaitable, Callable
from functools import cache
from typing import Annotated, ClassVar

import mcp_types
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from linked_fleet_gateway.extensions.mcp.message_context import MessageContext
from linked_fleet_gateway.extensions.mcp.replies import failure_result

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
    def published(cls) -> mcp_types.Tool:
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
            return failure_result("\n".join(["These arguments are not taken:", *wrong]))
        return await wanted.run(context, progress)

    async def run(self, context: MessageContext, progress: Progress) -> mcp_types.CallToolResult:
        raise NotImplementedError
