"""An event stream of a robot that the gateway has not met yet (``http/awaited_robots.py``)."""

import asyncio
from collections.abc import Awaitable, Callable

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.http.event_stream import HEARTBEAT_S, OPENING, STREAM_FIELDS, comment
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.scheduling import bucket_key
from linked_fleet_gateway.http.streams import EventStream, wants_events
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_identity.rights import Right
from linked_fleet_server.protocol import HTTP, HttpProtocol

_PAUSE_S = 1.0
Answer = Callable[[Request], Awaitable[ASGIApp]]


def awaits_robot(request: Request) -> bool:
    """Return True if a request for a resource that is not there may wait for its robot."""
    robot, caller, services = robot_of(request.scope["path"]), request.caller, request.services
    return (
        robot is not None
        and request.method == "GET"
        and HTTP in request.scope.get("extensions", ())
        and wants_events(request)
        and services.awaited_robots.is_awaited(robot, services.live.fleet.robots.get(robot))
        and services.awaited_robots.has_room(bucket_key(request.scope))
        and caller.has_right(Right.READ, robot)
        and caller.has_right(Right.SUBSCRIBE, robot)
    )


class AwaitingStream:
    """An event stream that begins when its robot is there. ``answer`` then answers the request."""

    def __init__(self, request: Request, answer: Answer) -> None:
        self._request, self._answer = request, answer
        self._robots, self._fleet = request.services.awaited_robots, request.services.live.fleet

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        http: HttpProtocol = scope["extensions"][HTTP]
        ended = asyncio.Event()
        http.on_shutdown = ended.set
        listener = asyncio.create_task(_listen(receive, ended))
        try:
            await send({"type": "http.response.start", "status": 200, "headers": STREAM_FIELDS})
            await _write(send, OPENING + comment("The robot is not there yet; the stream begins when it is."))
            with self._robots.counted(bucket_key(scope)):
                await self._wait(send, ended)
            stream = None if ended.is_set() or http.is_shutting_down else await self._stream()
        finally:
            listener.cancel()
            http.on_shutdown = None
        if stream is None:
            # The client returns, and gets the status that the resource then has.
            await send({"type": "http.response.body", "body": b"", "more_body": False})
        else:
            await stream(scope, receive, _Continued(send))

    async def _wait(self, send: Send, ended: asyncio.Event) -> None:
        robot, silent_s = robot_of(self._request.scope["path"]) or "", 0.0
        while not ended.is_set() and self._robots.is_awaited(robot, self._fleet.robots.get(robot)):
            try:
                async with asyncio.timeout(_PAUSE_S):
                    await ended.wait()
            except TimeoutError:
                silent_s += _PAUSE_S
            if silent_s >= HEARTBEAT_S:
                silent_s = 0.0
                await _write(send, comment())

    async def _stream(self) -> EventStream | None:
        if not self._request.credentials_valid():
            return None
        try:
            answer = await self._answer(self._request)
        except FleetError:
            return None
        return answer if isinstance(answer, EventStream) else None


class _Continued:
    """Sends a response whose head is sent already."""

    def __init__(self, send: Send) -> None:
        self._send = send

    async def __call__(self, message: Message) -> None:
        if message["type"] != "http.response.start":
            await self._send(message)


async def _write(send: Send, content: bytes) -> None:
    await send({"type": "http.response.body", "body": content, "more_body": True})


async def _listen(receive: Receive, ended: asyncio.Event) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
    ended.set()
