"""A tool of the protocol: its arguments, which are what its JSON Schema says, and what a call does."""

from collections.abc import Awaitable, Callable
from functools import cache
from typing import Annotated, ClassVar

import mcp_types
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from linked_fleet_gateway.extensions.mcp.asking import Asking
from linked_fleet_gateway.extensions.mcp.replies import failed

Progress = Callable[[float, float, str], Awaitable[None]]
"""Tells the client the share that is done, the whole, and the state."""
Target = Annotated[str, Field(max_length=2000)]
READS = mcp_types.ToolAnnotations(read_only_hint=True, open_world_hint=False)


class Tool(BaseModel):
    """A call of a tool. The name of a class is that of the tool, its docstring is the description for clients."""

    model_config = ConfigDict(extra="forbid")
    hints: ClassVar[mcp_types.ToolAnnotations] = READS

    @classmethod
    @cache
    def published(cls) -> mcp_types.Tool:
        schema = cls.model_json_schema()
        name, description = cls.__name__.lower(), " ".join(schema.pop("description").split())
        return mcp_types.Tool(name=name, description=description, input_schema=schema, annotations=cls.hints)

    @classmethod
    async def call(cls, asking: Asking, given: dict[str, object], progress: Progress) -> mcp_types.CallToolResult:
        """The result; an error that says which arguments are wrong, so that the client can mend them."""
        try:
            wanted = cls.model_validate(given)
        except ValidationError as error:
            wrong = [f"- {'.'.join(map(str, each['loc']))[:200]}: {each['msg']}" for each in error.errors()[:10]]
            return failed("\n".join(["These arguments are not taken:", *wrong]))
        return await wanted.run(asking, progress)

    async def run(self, asking: Asking, progress: Progress) -> mcp_types.CallToolResult:
        raise NotImplementedError
