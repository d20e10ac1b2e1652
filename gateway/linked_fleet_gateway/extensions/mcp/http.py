"""Messages over HTTP: read, limited and counted here, then passed to the SDK."""

import json
from functools import partial
from http import HTTPStatus
from typing import Any

from starlette.responses import Response
from starlette.types import ASGIApp

from linked_fleet_gateway.extensions.mcp.message_context import KEY, MessageContext
from linked_fleet_gateway.extensions.mcp.resources import PostMessage
from linked_fleet_gateway.extensions.mcp.sdk import Sdk
from linked_fleet_gateway.http.body import body_type, read_body
from linked_fleet_gateway.http.hosted import AsgiResponse
from linked_fleet_gateway.http.offload import Offload
from linked_fleet_gateway.http.pace import await_turn
from linked_fleet_gateway.http.read import read
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.streams import wants_events
from linked_fleet_gateway.rdf.json_input import ParseError, load_json
from linked_fleet_gateway.resources.resource import Resource

MAX_MESSAGE_BYTES = 272 * 1024
"""The longest body of an action, plus its envelope."""
SHORT_BYTES = 4096
"""Longest message that may stop robots."""
_MAX_DEPTH, _MAX_VALUES = 24, 24_000
_PARSE_ERROR, _INVALID_REQUEST = -32700, -32600  # JSON-RPC 2.0, 5.1


async def read_endpoint(request: Request, resource: Resource, endpoint: PostMessage) -> ASGIApp:
    """Return the description. There is no stream without a request, because the fleet has subscriptions of its own."""
    if wants_events(request):
        answer = _error(HTTPStatus.METHOD_NOT_ALLOWED, _INVALID_REQUEST, "The streams here are those of POST.")
        answer.headers["allow"] = "POST, DELETE"
        return answer
    return read(request, resource)


async def post_message(sdk: Sdk, request: Request, affords: PostMessage) -> ASGIApp:
    """Process one message, or end a session. Raises TooManyRequests, PayloadTooLarge, UnsupportedMediaType, Busy."""
    content = b""
    length = request.headers.get("content-length", "")
    may_stop = request.method == "POST" and length.isdecimal() and int(length) <= SHORT_BYTES
    if not may_stop:
        await await_turn(request)
    if request.method == "POST":
        body_type(request, PostMessage.body_types)
        content = await read_body(request, MAX_MESSAGE_BYTES)
        offload: Offload = request.services.offload
        try:
            message = await offload.run(partial(_parsed, content), len(content))
        except ParseError as error:
            return _error(HTTPStatus.BAD_REQUEST, _PARSE_ERROR, f"Parse error: {error}")
        if may_stop and not _stops(message):
            await await_turn(request)
    core = sdk.core
    context = MessageContext(request, affords.view, core.live.branches, core.actions.lifecycle.waiters, sdk.ending)
    return AsgiResponse(await sdk.app(), content, {KEY: context}, sdk.ending.set)


def _parsed(content: bytes) -> Any:
    try:
        return load_json(content.decode(), _MAX_DEPTH, _MAX_VALUES)
    except UnicodeDecodeError as error:
        raise ParseError("not UTF-8") from error


def _stops(message: Any) -> bool:
    """Return True for a message that stops robots, or cancels a call that moves them."""
    if not isinstance(message, dict):
        return False
    params = message.get("params")
    called = params.get("name") if message.get("method") == "tools/call" and isinstance(params, dict) else None
    return called == "stop" or message.get("method") == "notifications/cancelled"


def _error(status: HTTPStatus, code: int, text: str) -> Response:
    body = {"jsonrpc": "2.0", "id": None, "error": {"code": code, "message": text}}
    return Response(json.dumps(body), status, media_type="application/json")
