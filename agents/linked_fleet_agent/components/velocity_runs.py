"""Runs of actions whose inputs are velocities that hold for a time: the newest run moves, until it stands again."""

import asyncio
from abc import abstractmethod
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.ticks import Ticks

_TAKE_OVER_TICKS, _SILENCE_S = 3, 2.0


class VelocityRuns:
    """Part of a component that moves by velocities, whose ``on_tick`` calls ``note_tick``.

    Its actions take over: a newer run goes on at the speed of the earlier one, which then ends.
    """

    ticked_s: float | None = None
    """The time of the last tick."""

    def __init__(self) -> None:
        self._driver: Call[Any] | None = None
        self._ticks = Ticks()

    @property
    @abstractmethod
    def standing(self) -> bool:
        """True while it is at rest, and wants to be."""

    @abstractmethod
    def request(self, given: Mapping[str, Any], until_s: float) -> None:
        """Move as an input of the action says, until a time."""

    @abstractmethod
    def brake(self) -> None:
        """Come to rest within the limits."""

    @abstractmethod
    def tell(self, call: Call[Any]) -> None:
        """Give the feedback of a run. Raises what ends it."""

    def note_tick(self, now_s: float) -> None:
        """Let those go on who wait for a tick."""
        self.ticked_s = now_s
        self._ticks.happen()

    async def tick(self) -> float:
        """Wait for the next tick, and return its time.

        Raises TimeoutError if the agent ticks no more; its end has halted the motors.
        """
        async with asyncio.timeout(_SILENCE_S):
            await self._ticks.next()
        assert self.ticked_s is not None
        return self.ticked_s

    async def hold_for(self, call: Call[Any], given: Mapping[str, Any], duration_s: float) -> None:
        """Move like this for a time, and end when it stands, or when a newer run has taken over.

        One that was opened as a stream moves as its samples say, until it is told to end.
        """
        now_s = await self.tick() if self.ticked_s is None else self.ticked_s

        async def move() -> None:
            if call.stream is None:
                self.request(given, now_s + duration_s)
            else:
                await self._follow_samples(call)
            await self._until_standing(call)

        await self.carry_out(call, move)

    async def carry_out(self, call: Call[Any], move: Callable[[], Awaitable[None]]) -> None:
        """Carry out a run. However it ends, all stands, or a newer run has taken over."""
        self._driver = call
        try:
            await move()
        except asyncio.CancelledError:
            if call.replaced:
                await self._until_taken_over(call)
            raise
        finally:
            await self._come_to_rest(call)

    async def _follow_samples(self, call: Call[Any]) -> None:
        """Move as samples say. The speed of an earlier run is not taken over."""
        assert call.stream is not None
        self.brake()
        async for given in call.stream:
            if given is not None:
                self.request(given.input, given.until_s)
            self.tell(call)

    async def _until_standing(self, call: Call[Any]) -> None:
        while self._driver is call and not self.standing:
            await self.tick()
            self.tell(call)

    async def _until_taken_over(self, call: Call[Any]) -> None:
        """Wait for the newer run, which is stopped at times before it begins."""
        for _ in range(_TAKE_OVER_TICKS):
            if self._driver is call:
                await self.tick()

    async def _come_to_rest(self, call: Call[Any]) -> None:
        if self._driver is call:
            self.brake()
        while self._driver is call and not self.standing:
            await self.tick()
