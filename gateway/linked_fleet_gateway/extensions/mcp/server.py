"""The server of the MCP SDK: its handlers, and the limits of its sessions. Imported at the first message."""

import logging
from collections import Counter
from json import loads
from typing import Any, TypeAlias

import mcp_types as types
from mcp.server.auth.middleware.bearer_auth import AuthenticatedUser, AuthorizationContext
from mcp.server.auth.provider import AccessToken
from mcp.server.context import ServerRequestContext
from mcp.server.lowlevel import Server
from mcp.server.streamable_http import StreamableHTTPServerTransport
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from mcp.shared.exceptions import MCPError
from sse_starlette.sse import AppStatus
from starlette.types import Receive, Scope, Send

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.extensions.mcp.action_tools import Act, Rehearse, Stop
from linked_fleet_gateway.extensions.mcp.extension import McpSettings
from linked_fleet_gateway.extensions.mcp.message_context import KEY, MessageContext
from linked_fleet_gateway.extensions.mcp.read_tools import Find, Query, Read, contents, resources, templates
from linked_fleet_gateway.extensions.mcp.tool import Tool, failure_result, refusal_result
from linked_fleet_gateway.extensions.mcp.write_tool import Write
from linked_fleet_gateway.serving import ReplyTooLong, problem

MOST_CALLS = 32
"""Unfinished tool calls per client. Calls that stop robots do not count."""
TOOLS: tuple[type[Tool], ...] = (Find, Read, Query, Rehearse, Act, Write, Stop)
_BY_NAME = {each.definition().name: each for each in TOOLS}
_INSTRUCTIONS = """\
Linked Fleet: robots as linked resources. Use find to list robots, joints and actions with the JSON Schemas of action
bodies; read to get present values; rehearse to check an action without moving; act to move and wait for the end; stop
at any time. For several steps write a mission, which find describes as a container, and run it by act. A refusal names
the violated constraint and the permitted values; correct the call and repeat it.
Values have units (IRIs of QUDT); an unknown value is null."""
_Context: TypeAlias = ServerRequestContext[Any, Any]


def _message(context: _Context) -> MessageContext:
    assert context.request is not None
    found: MessageContext = context.request.scope["extensions"][KEY]
    return found


class Handlers:
    """Answers requests, each with the rights of the caller that sent the message."""

    def __init__(self) -> None:
        self._calls: Counter[str] = Counter()

    async def list_tools(self, context: _Context, params: object) -> types.ListToolsResult:
        queries = _message(context).core.live.branches.fleet_branch("query") is not None
        return types.ListToolsResult(tools=[each.definition() for each in TOOLS if queries or each is not Query])

    async def call_tool(self, context: _Context, params: types.CallToolRequestParams) -> types.CallToolResult:
        message, name = _message(context), params.name
        if name not in _BY_NAME:
            raise MCPError(types.INVALID_PARAMS, f"Unknown tool: {name[:100]}")
        client = "" if name == "stop" else message.request.client_key
        if client and self._calls[client] >= MOST_CALLS:
            return failure_result(f"{MOST_CALLS} of your calls have not ended yet; wait for one of them.")
        self._calls[client] += 1
        try:
            return await _BY_NAME[name].call(message, params.arguments or {}, context.session.report_progress)
        except FleetError as error:
            return refusal_result(loads(problem(error, None)[0]))
        except ReplyTooLong as error:
            return failure_result(f"{error} Read a part of it.")
        finally:
            self._calls -= Counter([client])


async def _list_resources(context: _Context, params: object) -> types.ListResourcesResult:
    return types.ListResourcesResult(resources=resources(_message(context)))


async def _list_templates(context: _Context, params: object) -> types.ListResourceTemplatesResult:
    return types.ListResourceTemplatesResult(resource_templates=templates(_message(context)))


async def _read_resource(context: _Context, params: types.ReadResourceRequestParams) -> types.ReadResourceResult:
    return types.ReadResourceResult(contents=[await contents(_message(context), params.uri)])


class Sessions(StreamableHTTPSessionManager):
    """The sessions of all clients.

    Each belongs to the client that opened it; ``most_of_client`` is the limit per client.
    """

    most_of_client = 0

    async def handle_request(self, scope: Scope, receive: Receive, send: Send) -> None:
        message: MessageContext = scope["extensions"][KEY]
        user = AuthenticatedUser(AccessToken(token="", client_id=message.request.client_key, scopes=[]))
        await super().handle_request({**scope, "user": user}, receive, send)

    def _admit_session(self, requestor: AuthorizationContext | None) -> StreamableHTTPServerTransport | None:
        own = sum(each == requestor for each in self._session_owners.values())
        return None if own >= self.most_of_client else super()._admit_session(requestor)


def new_manager(version: str, settings: McpSettings) -> Sessions:
    # Streams must end with their own gateway, not with the first server of the process.
    AppStatus.enable_automatic_graceful_drain = AppStatus.should_exit = False
    logging.getLogger("mcp").setLevel(logging.ERROR)  # it logs session ids and input of strangers
    handlers = Handlers()
    server = Server[Any](
        "linked-fleet",
        version=version,
        title="Linked Fleet",
        instructions=_INSTRUCTIONS,
        get_tool_input_schema=lambda name: {},  # no member of an input is a header field
        on_list_tools=handlers.list_tools,
        on_call_tool=handlers.call_tool,
        on_list_resources=_list_resources,
        on_list_resource_templates=_list_templates,
        on_read_resource=_read_resource,
    )
    server.middleware.clear()  # the gateway itself traces requests
    sessions = Sessions(server, session_idle_timeout=settings.idle_s, max_sessions=settings.sessions)
    sessions.most_of_client = settings.sessions_per_client
    return sessions
