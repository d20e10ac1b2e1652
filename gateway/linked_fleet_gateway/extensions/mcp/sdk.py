"""The MCP SDK, loaded in a thread at the first message and ended with the gateway."""

import asyncio
from importlib import import_module
from importlib.metadata import version
from typing import Any

from starlette.types import ASGIApp

from linked_fleet_gateway.extensions.mcp.settings import McpSettings
from linked_fleet_gateway.http.extension import Core
from linked_fleet_gateway.runtime.background import end

_SERVER = "linked_fleet_gateway.extensions.mcp.server"


class Sdk:
    """Loads nothing before the first message. ``ending`` is set when the gateway ends."""

    def __init__(self, core: Core) -> None:
        self.core, self.ending = core, asyncio.Event()
        self._app: asyncio.Future[ASGIApp] = asyncio.get_running_loop().create_future()
        self._running: asyncio.Task[Any] | None = None

    async def app(self) -> ASGIApp:
        """Return the ASGI application that accepts messages."""
        if self._running is None:
            self._running = asyncio.create_task(self._run())
        awaited: list[asyncio.Future[Any]] = [self._app, self._running]
        done, _ = await asyncio.wait(awaited, return_when=asyncio.FIRST_COMPLETED)
        return self._app.result() if self._app in done else self._running.result()

    async def end(self) -> None:
        self.ending.set()
        await end([] if self._running is None else [self._running])

    async def _run(self) -> Any:
        server = await asyncio.to_thread(import_module, _SERVER)  # takes one or two seconds
        manager = server.new_manager(version("linked-fleet"), self.core.section(McpSettings))
        async with manager.run():
            self._app.set_result(manager.handle_request)
            await asyncio.Event().wait()  # until this is cancelled
