"""A component that tells the state of a ROS robot's graph: what is there, what is missing, which clock."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable
from typing import Annotated, Literal

from msgspec import Meta

from linked_fleet_agent.components.component import Component, value

_log = logging.getLogger(__name__)

PERIOD_S = 2.0
"""Time between two looks at what changes slowly, such as the states of controllers."""
MAX_SENTENCES = 64
Sentence = Annotated[str, Meta(max_length=512)]


class RosStatus(Component, rename="camel", rate_hz=1, blocking=False, stale_s=10):
    """The driver of this robot of ROS, and what it sees of the graph."""

    name, title = "driver", "Driver"

    def __init__(
        self,
        missing: Callable[[], Iterable[str]],
        clock: Callable[[], Literal["system", "simulated"]],
        bad_messages: Callable[[], int],
        look: Callable[[], Awaitable[None]],
    ) -> None:
        self._missing, self._clock, self._bad_messages = missing, clock, bad_messages
        self._look = look
        self._looking: asyncio.Future[None] | None = None
        self._due_s = -1.0

    @value
    def missing(self) -> Annotated[list[Sentence], Meta(title="Missing", max_length=MAX_SENTENCES)]:
        """Return what the robot lacks, or offers in a way that cannot be used, in sentences."""
        return [each[:512] for each in self._missing()][:MAX_SENTENCES]

    @value
    def time_source(self) -> Annotated[Literal["system", "simulated"], Meta(title="Clock of its nodes")]:
        """Tell whether the nodes have the clock of their system, or a simulated one (/clock)."""
        return self._clock()

    @value
    def bad_messages(self) -> Annotated[int, Meta(ge=0, title="Messages that could not be read")]:
        """Return how many messages could not be read since the driver has begun."""
        return self._bad_messages()

    def on_tick(self, now_s: float) -> None:
        if now_s >= self._due_s and (self._looking is None or self._looking.done()):
            self._due_s = now_s + PERIOD_S
            self._looking = asyncio.ensure_future(self._look_once())

    def on_halt(self) -> None:
        """Look no more."""
        if self._looking is not None:
            self._looking.cancel()

    async def _look_once(self) -> None:
        try:
            await self._look()
        except Exception:  # noqa: BLE001 - whatever it is, the robot must go on, and the next look may succeed
            _log.exception("the graph of ROS could not be looked at")
