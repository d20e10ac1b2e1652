"""The extension ``mcp``: the Model Context Protocol, by streamable HTTP at ``/mcp``.

The resource ``/mcp`` describes itself and accepts messages. Messages are read, limited and counted here, then passed to
the MCP SDK. The SDK is loaded in a thread at the first message and ends with the gateway.
"""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from importlib import import_module
from importlib.metadata import version
from typing import Any, ClassVar

from pyoxigraph import Literal
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from linked_fleet_base.settings import Section, setting, whole_number
from linked_fleet_gateway.api import (
    AsgiResponse,
    Core,
    Extension,
    FleetBranch,
    Found,
    Mount,
    Request,
    RequestView,
    Resource,
    Right,
    await_turn,
    body_type,
    cancel_tasks,
    read_resource,
)
from linked_fleet_gateway.extensions.mcp.envelope import InvalidMessage, UnderWay, check_envelope, request_id
from linked_fleet_gateway.extensions.mcp.message_context import KEY, MessageContext
from linked_fleet_gateway.serving import read_body, wants_events
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.json_input import ParseError, load_json
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import DCTERMS, RDFS

PATH, _TITLE = "/mcp", "Model Context Protocol"


@dataclass(frozen=True)
class PostMessage:
    """Send a message, or end a session. ``view`` is that of the caller.

    The message itself changes nothing: each operation in it is a separate request with its own rights and audit entry.
    """

    view: RequestView
    methods: ClassVar[tuple[str, ...]] = ("POST", "DELETE")
    body_types: ClassVar[tuple[str, ...]] = (JSON,)
    needs: ClassVar[tuple[Right, ...]] = (Right.READ, Right.STOP)
    reads: ClassVar[bool] = True


def _resolve(view: RequestView, rest: list[str]) -> Found:
    if rest:
        return None

    def describe(graph: Graph) -> None:
        graph.add(view.iri(PATH), DCTERMS.title, Literal(_TITLE))
        graph.add(view.iri(PATH), RDFS.comment, Literal("Clients of the protocol connect here, by streamable HTTP."))
        graph.add(view.iri(PATH), RDFS.seeAlso, view.iri("/"))

    return Resource(
        PATH, _TITLE, describe, affords=PostMessage(view), remote=PostMessage(view), publishes_changes=False
    )


BRANCH = FleetBranch(PATH[1:], None, _resolve)


@dataclass(frozen=True)
class McpSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_MCP_"

    sessions: int = setting(whole_number(1, 10_000), "200", "sessions of the Model Context Protocol at once")
    sessions_per_client: int = setting(
        whole_number(1, 10_000), "20", "sessions of one client (an identity, else an address)"
    )
    idle_s: int = setting(whole_number(1, 86_400), "600", "seconds without a request until a session ends")


_SERVER = "linked_fleet_gateway.extensions.mcp.server"


class Sdk:
    """Loads nothing before the first message. ``ending`` is set when the gateway ends."""

    def __init__(self, core: Core) -> None:
        self.core, self.ending, self.under_way = core, asyncio.Event(), UnderWay()
        self._app: asyncio.Future[ASGIApp] = asyncio.get_running_loop().create_future()
        self._running: asyncio.Task[Any] | None = None

    async def app(self) -> ASGIApp:
        """Return the ASGI application that accepts messages."""
        if self._running is None or self._running.done():  # after an error it is loaded again
            self._app = asyncio.get_running_loop().create_future()
            self._running = asyncio.create_task(self._run())
        awaited: list[asyncio.Future[Any]] = [self._app, self._running]
        done, _ = await asyncio.wait(awaited, return_when=asyncio.FIRST_COMPLETED)
        return self._app.result() if self._app in done else self._running.result()

    async def end(self) -> None:
        self.ending.set()
        await cancel_tasks([] if self._running is None else [self._running])

    async def _run(self) -> Any:
        server = await asyncio.to_thread(import_module, _SERVER)  # takes one or two seconds
        manager = server.new_manager(version("linked-fleet"), self.core.section(McpSettings))
        async with manager.run():
            self._app.set_result(manager.handle_request)
            await asyncio.Event().wait()  # until this is cancelled


MAX_MESSAGE_BYTES = 272 * 1024
"""The longest body of an action, plus its envelope."""
SHORT_BYTES = 4096
"""Longest message that may stop robots."""
_MAX_DEPTH, _MAX_VALUES = 24, 24_000
_PARSE_ERROR, _INVALID_REQUEST = -32700, -32600  # JSON-RPC 2.0, 5.1


async def read_endpoint(request: Request, resource: Resource, endpoint: PostMessage) -> ASGIApp:
    """Return the description. There is no stream without a request, because the fleet has subscriptions of its own."""
    if wants_events(request):
        answer = _error(
            HTTPStatus.METHOD_NOT_ALLOWED,
            _INVALID_REQUEST,
            "This endpoint has no stream for GET; responses to POST are streams.",
        )
        answer.headers["allow"] = "POST, DELETE"
        return answer
    return read_resource(request, resource)


async def post_message(sdk: Sdk, request: Request, affords: PostMessage) -> ASGIApp:
    """Process one message, or end a session. Raises TooManyRequests, PayloadTooLarge, UnsupportedMediaType, Busy."""
    content, message = b"", dict[str, Any]()
    length = request.headers.get("content-length", "")
    may_stop = request.method == "POST" and length.isdecimal() and int(length) <= SHORT_BYTES
    if not may_stop:
        await await_turn(request)
    if request.method == "POST":
        body_type(request, PostMessage.body_types)
        content = await read_body(request, MAX_MESSAGE_BYTES)
        try:
            message = await request.services.offload.run(partial(_parsed, content), len(content))
        except ParseError as error:
            return _error(HTTPStatus.BAD_REQUEST, _PARSE_ERROR, f"Parse error: {error}")
        try:
            check_envelope(message)
        except InvalidMessage as error:
            return _error(HTTPStatus.BAD_REQUEST, _INVALID_REQUEST, f"Invalid Request: {error}.")
        if may_stop and not _stops(message):
            await await_turn(request)
    context = MessageContext(request, affords.view, sdk.core, sdk.ending)
    response = AsgiResponse(await sdk.app(), content, {KEY: context}, sdk.ending.set)
    return _unless_in_use(sdk.under_way, request, message, response)


def _unless_in_use(under_way: UnderWay, request: Request, message: dict[str, Any], response: ASGIApp) -> ASGIApp:
    client, session = request.client_key, request.headers.get("mcp-session-id", "")

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        try:
            with under_way.held(client, session, request_id(message)):
                await response(scope, receive, send)
        except InvalidMessage as error:
            refusal = _error(HTTPStatus.BAD_REQUEST, _INVALID_REQUEST, f"Invalid Request: {error}.")
            await refusal(scope, receive, send)

    return answer


def _parsed(content: bytes) -> Any:
    try:
        return load_json(content.decode(), _MAX_DEPTH, _MAX_VALUES)
    except UnicodeDecodeError as error:
        raise ParseError("not UTF-8") from error


def _stops(message: dict[str, Any]) -> bool:
    """Return True for a message that stops robots, or cancels a call that moves them."""
    params = message.get("params")
    called = params.get("name") if message.get("method") == "tools/call" and isinstance(params, dict) else None
    return called == "stop" or message.get("method") == "notifications/cancelled"


def _error(status: HTTPStatus, code: int, text: str) -> Response:
    body = {"jsonrpc": "2.0", "id": None, "error": {"code": code, "message": text}}
    return Response(json.dumps(body), status, media_type="application/json")


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
