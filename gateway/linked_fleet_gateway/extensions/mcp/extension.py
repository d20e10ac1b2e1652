"""The extension ``mcp``: the Model Context Protocol, by streamable HTTP at ``/mcp``."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

from linked_fleet_gateway.extensions.mcp.http import post_message, read_endpoint
from linked_fleet_gateway.extensions.mcp.resources import BRANCH, PATH, PostMessage
from linked_fleet_gateway.extensions.mcp.sdk import Sdk
from linked_fleet_gateway.extensions.mcp.settings import McpSettings
from linked_fleet_gateway.http.extension import Core, Extension, Mount


class McpExtension(Extension):
    name = "mcp"
    modules = ("mcp",)
    at_root = (PATH[1:],)
    carriers = (PATH[1:],)
    request_fields = ("mcp-session-id", "mcp-protocol-version", "mcp-method", "mcp-name")
    response_fields = ("mcp-session-id",)
    settings = McpSettings

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        sdk = Sdk(core)
        yield Mount((BRANCH,), readers={PostMessage: read_endpoint}, writers={PostMessage: partial(post_message, sdk)})
        await sdk.end()
