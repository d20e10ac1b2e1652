"""The heartbeat of a gateway: messages by which agents see that its event loop runs.

Zenoh's own threads keep a liveliness token alive even while the event loop hangs. Heartbeats stop with the loop.
"""

import asyncio
import logging
from contextlib import suppress

from linked_fleet_agent.wire.transport import HEARTBEAT_S
from linked_fleet_link.transport import Session, TransportError
from linked_fleet_runtime.background import supervised

_log = logging.getLogger(__name__)

_SHORTEST_S = 0.1  # shortest interval, so that a thousand robots that join at once do not cause a thousand heartbeats


class Heartbeat:
    """Sends on ``key`` from the event loop every ``HEARTBEAT_S``, from ``start`` to ``close``."""

    def __init__(self, session: Session, key: str) -> None:
        self._publish = session.declare_heartbeat(key)
        self._failing = False
        self._wanted = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        self._wanted.set()
        self._task = supervised(self._beat, "heartbeat", _log, "no heartbeat can be sent", _SHORTEST_S)

    def send_now(self) -> None:
        """Send the next one now, for an agent that has just appeared."""
        self._wanted.set()

    def close(self) -> None:
        if self._task is not None:
            self._task.cancel()

    async def _beat(self) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(HEARTBEAT_S - _SHORTEST_S):
                await self._wanted.wait()
        self._wanted.clear()
        try:
            self._publish()
            self._failing = False
        except TransportError as error:
            if not self._failing:
                _log.error("no heartbeat can be sent, so robots hold: %s", error)
            self._failing = True
