"""The world: its resources in the tree, its objects, and the checks of motions in it."""

from contextlib import AsyncExitStack
from types import TracebackType
from typing import Self

from gateway.graph.vocab import LF
from gateway.graph.wing import FleetWing
from gateway.live import Live
from gateway.world.checks import Checks
from gateway.world.memory import Objects
from gateway.world.placement import WORLD
from gateway.world.resources import in_world
from gateway.world.store import ObjectStore


class World:
    """An async context manager; entering it adds the world to the tree."""

    def __init__(self, live: Live, url: str, namespace: str) -> None:
        self._live = live
        self.objects = Objects(live, ObjectStore(url, namespace))
        self._checks = Checks(live, self.objects.known)
        self.judge = self._checks.judge
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> Self:
        await self._stack.enter_async_context(self.objects)
        await self._stack.enter_async_context(self._checks)
        known = self.objects.known
        self._live.add(FleetWing(WORLD[1:], LF.world, lambda sight, rest: in_world(sight, rest, known)))
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()
